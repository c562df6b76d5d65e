"""vlafuzz from Python: fuzz and triage a policy, read a store, compare a policy with a corpus.

For example::

    import vlafuzz

    run = vlafuzz.fuzz(policy, task="pick-up", budget=300)
    store = vlafuzz.open_store(run.store)
    for cause in store.causes():
        print(*cause.conditions, cause.rate, cause.scene)
    store.findings().to_dataframe()

``policy`` is an object or a name. Options have the names of the command line's flags.
"""

import copy
from collections.abc import Callable
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any

from vlafuzz.campaign.config import SEARCH, RunConfig, further, plan, start
from vlafuzz.campaign.tally import Summary, Tally
from vlafuzz.common.deadline import deadline
from vlafuzz.common.plugins import EVERYTHING, OBJECT, trusting
from vlafuzz.errors import UsageError, VlafuzzError
from vlafuzz.exports.training import write_demonstrations
from vlafuzz.failures.corpus.diff import Difference, diff_policies
from vlafuzz.failures.corpus.policies import bisect_checkpoints, compare_policies
from vlafuzz.failures.listed import failures_of
from vlafuzz.failures.triage import pipeline
from vlafuzz.failures.triage.pipeline import Allowance, TriageSummary, summarise
from vlafuzz.policies.base import Policy
from vlafuzz.rollouts.scene_runner import SimulatorSceneRunner
from vlafuzz.search.base import looks_for_causes
from vlafuzz.store.records import Run
from vlafuzz.store.store import Store
from vlafuzz.stored import StoredFinding, StoredResults
from vlafuzz.worlds.evaluator import Film


def fuzz(
    policy: Policy | str,
    *,
    certify: bool | None = None,
    time: str | None = None,
    watch: Callable[[Tally], None] = lambda tally: None,
    **flags: Any,
) -> Summary:
    """Run a campaign; it ends when its budget is spent, and the commonest causes are certified.

    Args:
        policy: an object, which stays open and works in this process, or a name as on the command line.
        certify: whether to certify the commonest causes, for about as many rollouts as the budget; by default if the
            strategy looks for causes.
        time: wall clock that it takes at most, such as "1h30m"; half of it for the run where causes follow.
        watch: called after every trial.
        flags: fields of ``RunConfig``, such as ``task``, ``budget``, ``strategy``, ``seed`` and ``store``.

    Raises:
        UsageError: a name, number or file is wrong.
        VlafuzzError: every rollout ended in an error.
    """
    until, own = deadline("time", time), None if isinstance(policy, str) else policy
    name = policy if isinstance(policy, str) else f"{OBJECT}{policy.spec.name}"
    flags.setdefault("workers", 1)  # more are processes, which run the caller's script again
    planned = plan(RunConfig(policy=name, **flags), policy=_kept_open(own) if own else None)
    certifying = looks_for_causes(planned.strategy) if certify is None else certify
    summary = start(planned, watch, until.after(SEARCH) if certifying else until)
    if summary.unjudged and summary.first_error:
        raise VlafuzzError(summary.unjudged, hint=f"the errors are in {summary.store}: store.trials()")
    if certifying:
        with Store.open(Path(summary.store), "write") as store, trusting(name):
            runner, allowance = partial(_runner, Path(summary.store), own), Allowance(deadline=until)
            pipeline.certify_causes(store, runner, summary.run, allowance=allowance)
        if (rest := further(planned, summary.run)) and not until.passed:
            summary = start(rest, watch, until)
            with Store.open(Path(summary.store), "write") as store, trusting(name):
                pipeline.certify_causes(store, runner, summary.run, allowance=allowance)
    return summary


def open_store(path: Path | str) -> StoredResults:
    """The runs, trials, failures and causes of a store, as rows and data frames; StoreError if it is none."""
    return StoredResults(path)


def film(
    store: Path | str,
    finding: StoredFinding,
    policy: Policy | None = None,
    *,
    witness: bool = False,
    trust: bool = False,
) -> Film:
    """What the policy does in the scene of a failure, or with ``witness`` the actions that solve it.

    Args:
        policy: the object that the store's runs are of; None for runs of named policies.
        trust: load a ``python:`` policy that the store names, as ``--trust`` does.

    Raises:
        PrerequisiteError: nothing can be rendered here.
        UsageError: the failure has no witness, or cannot be rolled out.
    """
    path = Path(store)
    with Store.open(path) as opened:
        run = next(run for run in opened.runs() if run.id == finding.run)
        failure = next(one for one in failures_of(opened, run.id) if finding.found in one.found)
    solution = failure.witness
    if witness and solution is None:
        raise UsageError(f"{finding.found}: has no witness", hint="`vlafuzz triage` looks for one")
    with trusting(*[EVERYTHING] * trust), closing(_runner(path, policy, run)) as runner:
        made = runner.film(failure.scene, solution.actions if witness and solution else None)
    if isinstance(made, str):
        raise UsageError(f"{finding.scene}: cannot be rolled out: {made}", hint="`vlafuzz replay` shows more")
    return made


def triage(
    store: Path | str,
    policy: Policy | None = None,
    *,
    limit: int | None = None,
    rollouts: int | None = None,
    time: str | None = None,
    trust: bool = False,
    watch: Callable[[pipeline.Progress], None] = lambda progress: None,
) -> TriageSummary:
    """Confirm, witness, shrink and attribute the failures of a store that were not triaged yet.

    Args:
        policy: the object that the store's runs are of; None for runs of named policies.
        limit: the most failures to triage.
        rollouts: of the policy, after which no further failure is begun.
        time: wall clock that it takes at most, such as "30m".
        trust: load the code of a ``python:`` policy that the store names.
        watch: called after every failure.
    """
    Store.open(Path(store)).close()  # to write, a missing file would be made a store
    with Store.open(Path(store), "write") as opened, trusting(*[EVERYTHING] * trust):
        pipeline.triage(
            opened,
            partial(_runner, Path(store), policy),
            limit=limit,
            allowance=Allowance(rollouts, deadline("time", time)),
            watch=watch,
        )
        return summarise(opened)


def diff(
    a: Path | str,
    b: Path | str,
    policy_a: str | None = None,
    policy_b: str | None = None,
    *,
    trust: bool = False,
    **options: Any,
) -> Difference:
    """Compare two policies by the certified causes of two stores or corpora: fixed, remaining, new.

    Args:
        policy_a: the name of the first policy, if it is another one than in ``a``; ``policy_b`` likewise.
        trust: load the code of a ``python:`` policy that a store names.
        options: ``alpha`` and ``watch`` of ``diff_policies``.
    """
    with trusting(*[EVERYTHING] * trust):
        return diff_policies(Path(a), Path(b), policy_a, policy_b, **options)


bisect, demonstrate, regress = bisect_checkpoints, write_demonstrations, compare_policies


def _runner(store: Path, policy: Policy | None, run: Run) -> SimulatorSceneRunner:
    return SimulatorSceneRunner(store, run.manifest, _kept_open(policy) if policy else None)


def _kept_open(policy: Policy) -> Policy:
    """The policy, but for ``close``: whoever made it closes it."""
    kept = copy.copy(policy)
    kept.close = lambda: None  # type: ignore[method-assign]
    return kept
