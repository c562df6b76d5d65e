"""triage: work through the findings of a store, here or in several processes."""

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from functools import partial
from itertools import chain, count, groupby, islice
from typing import NamedTuple

from vlafuzz.deadline import Deadline
from vlafuzz.scene import Scene
from vlafuzz.store.records import Finding, Run, Triaged
from vlafuzz.store.store import Store
from vlafuzz.triage.pool import Make, PooledRunner, process_pool, side_by_side
from vlafuzz.triage.scene_runner import SimulatorSceneRunner
from vlafuzz.triage.shared_runner import SharedRunner
from vlafuzz.triage.triager import SceneRunner, Triager

PER_CAUSE = 50  # rollouts of the policy to certify a cause, about: its scene is nearly minimal already
PER_FINDING = 100  # rollouts to triage a finding, about: 50 to 180
SAMPLE = 200  # rollouts that tell how long one takes


class Progress(NamedTuple):
    """How far triage is: findings done, findings in all, and rollouts so far."""

    done: int
    findings: int
    rollouts: int


def expected(store: Store, findings: int, workers: int) -> float:
    """Seconds that triage of so many findings takes, at the speed of the rollouts that found them."""
    runs = store.runs()
    newest_first = chain.from_iterable(_seconds(store, run) for run in reversed(runs))
    seconds = list(islice(newest_first, SAMPLE)) or [0.0]
    at_once = max(workers, _at_once(store, runs[-1]) / 2 if runs else 0.0)
    return PER_FINDING * findings * sum(seconds) / len(seconds) / at_once


def _seconds(store: Store, run: Run) -> Iterator[float]:
    return (rollout.seconds for trial in store.trials(run.id) for rollout in trial.outcome.rollouts)


def _at_once(store: Store, run: Run) -> float:
    """How many rollouts a run had at a time behind a server, of which triage fills about half; else none."""
    if "://" not in run.manifest.policy or not run.seconds:
        return 0.0
    return sum(_seconds(store, run)) / run.seconds


@dataclass
class Allowance:
    """What triage may take: once it is used up, no further finding is begun.

    A finding is not begun either if less time is left than those before it took on average. What the deadline
    interrupts all the same is left for the next triage.

    Attributes:
        rollouts: of the policy; None for no limit. ``spent``: by the findings that are done.
    """

    rollouts: int | None = None
    deadline: Deadline = field(default_factory=Deadline)
    spent: int = 0
    _seconds: list[float] = field(default_factory=list)

    def charge(self, triaged: Triaged) -> None:
        self.spent += triaged.policy_rollouts
        self._seconds.append(triaged.seconds)

    @property
    def used_up(self) -> bool:
        takes = sum(self._seconds) / max(len(self._seconds), 1)
        return self.deadline.left <= takes or (self.rollouts is not None and self.spent >= self.rollouts)


def triage(
    store: Store,
    runner: Make,
    *,
    findings: Sequence[Finding] | None = None,
    max_rollouts: int | None = None,
    limit: int | None = None,
    allowance: Allowance | None = None,
    workers: int = 1,
    watch: Callable[[Progress], None] = lambda progress: None,
) -> int:
    """Triage every finding that was not triaged yet; each result is stored at once.

    Under a limit, findings that show causes come first, and the first finding of every other cell before the
    second of any, as it is more likely to have another cause.

    Args:
        runner: makes a scene runner for the findings of a run; picklable where there are several workers.
        findings: by default all of the store.
        max_rollouts: of the policy, to shrink, certify and attribute one finding; None for 200, or 1000 for a
            stochastic policy.
        limit: the most findings to triage.
        allowance: the rollouts and the time that it may take; by default there is no limit.
        watch: called after every finding.

    Returns:
        The number of findings that could not be judged, as the policy broke or the scene is no longer fair.
        They are left as they are, and tried again by the next call.

    Raises:
        SimulatorError: a worker died.
    """
    done = {triaged.key for triaged in store.triaged()}
    runs = {run.id: run for run in store.runs()}
    causes = [finding.key for run in runs for finding in cause_findings(store, run)]
    blamed = _blamed(store, runs)
    ordered = _causes_first(store.findings() if findings is None else findings, causes)
    todo = [finding for finding in ordered if finding.key not in done][:limit]
    todo.sort(key=lambda finding: finding.run)
    jobs = [
        Job(runs[number], list(several), max_rollouts, store.passing(number), blamed)
        for number, several in groupby(todo, lambda finding: finding.run)
    ]
    allowance = allowance or Allowance()
    unjudged, rollouts = 0, 0
    watch(Progress(0, len(todo), 0))
    if workers == 1:
        results = _here(runner, jobs, allowance)
    else:
        results = _in_processes(runner, jobs, workers, allowance)
    for number, triaged in enumerate(results, start=1):
        if triaged is None:
            unjudged += not allowance.used_up
        else:
            allowance.charge(triaged)
            store.settle(triaged)
            rollouts += triaged.policy_rollouts + triaged.expert_rollouts
        watch(Progress(number, len(todo), rollouts))
    return unjudged


class Job(NamedTuple):
    """The findings of one run that are to be triaged; the last three fields are those of ``Triager``."""

    run: Run
    findings: Sequence[Finding]
    max_rollouts: int | None
    passing: Sequence[Scene]
    blamed: Mapping[Scene, Sequence[str]]

    def triager(self, runner: SceneRunner, deadline: Deadline | None = None) -> Triager:
        until = deadline or Deadline()
        return Triager(runner, self.max_rollouts, self.passing, self.blamed, deadline=until)


def job_of(store: Store, run: Run, findings: Sequence[Finding]) -> Job:
    """The job of some findings of a run, with what that run knows."""
    return Job(run, findings, None, store.passing(run.id), _blamed(store, [run.id]))


def _here(make: Make, jobs: Sequence[Job], allowance: Allowance) -> Iterator[Triaged | None]:
    """Triage in this process, run by run; behind a server, as many findings at a time as it takes scenes."""
    for job in jobs:
        with closing(make(job.run)) as runner:
            if isinstance(runner, SimulatorSceneRunner) and runner.lanes > 1:
                shared = SharedRunner(runner)
                allowed = partial(_allowed, job.triager(shared, allowance.deadline), allowance)
                yield from shared.side_by_side(allowed, job.findings)
                continue
            triager = job.triager(runner, allowance.deadline)
            for finding in job.findings:
                if allowance.used_up:
                    return
                yield triager.triage(finding)


def _in_processes(
    make: Make, jobs: Sequence[Job], workers: int, allowance: Allowance
) -> Iterator[Triaged | None]:
    """Triage as many findings at a time as there are workers, whose rollouts all workers share.

    Results come in the order in which they are done.
    """
    with process_pool(workers) as pool:
        for job in jobs:
            triager = job.triager(PooledRunner(pool, make, job.run), allowance.deadline)
            allowed = partial(_allowed, triager, allowance)
            for _, triaged in side_by_side(pool, workers, allowed, job.findings):
                yield triaged


def _allowed(triager: Triager, allowance: Allowance, finding: Finding) -> Triaged | None:
    return None if allowance.used_up else triager.triage(finding)


def certify_causes(
    store: Store,
    runner: Make,
    run: int,
    *,
    allowance: Allowance | None = None,
    workers: int = 1,
    watch: Callable[[Progress], None] = lambda progress: None,
) -> int:
    """Triage the findings that show the commonest causes of a run, which takes about as long as the run.

    The next commonest cause takes the place of one that cannot be certified, or that is the same as another,
    as long as the rollouts are no more than those of the run.

    Args:
        runner, allowance, watch: see ``triage``.

    Returns:
        The number of findings that could not be judged, see ``triage``.
    """
    budget = next(each.manifest.budget for each in store.runs() if each.id == run)
    waiting, tried, unjudged = cause_findings(store, run), list[Finding](), 0
    number, allowance = affordable(budget), allowance or Allowance()
    while number > 0 and waiting and not allowance.used_up:
        some, waiting = waiting[:number], waiting[number:]
        unjudged += triage(store, runner, findings=some, allowance=allowance, workers=workers, watch=watch)
        tried += some
        keys = {finding.key for finding in tried}
        rows = [row for row in store.triaged() if row.key in keys]
        left = max(budget, PER_CAUSE) - sum(row.policy_rollouts for row in rows)
        firm = {row.signature for row in rows if row.bucket in ("minimal", "base")}
        number = min(affordable(budget) - len(firm), round(left / PER_CAUSE))
    return unjudged


def cause_findings(store: Store, run: int) -> list[Finding]:
    """The findings that show the causes of a run, in order of rank."""
    attribution = store.causes(run)
    if attribution is None:
        return []
    findings = {finding.scene: finding for finding in store.findings(run)}
    scenes = dict.fromkeys(cause.scene for cause in attribution.causes)
    return [findings[scene] for scene in scenes if scene in findings]


def findings_in_order(store: Store, run: int) -> list[Finding]:
    """The findings of a run in the order of ``triage`` under a limit."""
    return _causes_first(store.findings(run), [finding.key for finding in cause_findings(store, run)])


def _blamed(store: Store, runs: Iterable[int]) -> dict[Scene, tuple[str, ...]]:
    """The operators of each cause, by the scene that shows it."""
    attributions = filter(None, map(store.causes, runs))
    causes = [cause for attribution in attributions for cause in attribution.causes]
    return {cause.scene: cause.operators for cause in causes if cause.scene}


def affordable(budget: int) -> int:
    """The number of causes that a run with this budget certifies."""
    return max(1, budget // PER_CAUSE)


def _causes_first(findings: Sequence[Finding], causes: Sequence[tuple[str, str]]) -> list[Finding]:
    """Findings sorted: those of causes, by their keys, then the first of each cell, the second, and so on."""
    number: defaultdict[str, Iterator[int]] = defaultdict(count)
    ranks = {key: rank - len(causes) for rank, key in enumerate(causes)}
    return sorted(findings, key=lambda finding: ranks.get(finding.key, next(number[finding.cell])))
