"""The failures of a run: each failing scene once, and when in the run it was found."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from vlafuzz.campaign.results import Embed
from vlafuzz.common.statistics import Share
from vlafuzz.errors import UsageError
from vlafuzz.failures.triage.pipeline import findings_in_order
from vlafuzz.lab.compare.certified import Certified, certified, known_results
from vlafuzz.model.outcome import Verdict
from vlafuzz.model.scene import Scene
from vlafuzz.search.probability import Probability
from vlafuzz.store.records import Run
from vlafuzz.store.store import Store

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False, kw_only=True)
class Failure:
    """A failing scene of a run; for its cell and quality see ``scoring.cell`` and ``quality``.

    Attributes:
        severity: its distance from nominal, the sum over the operators.
        spent: rollouts of the run when it was found, its own included.
        vector: embedding of the scene, in which distance means difference.
    """

    scene: Scene
    cell: str
    severity: float
    quality: float
    spent: int
    vector: Vector


@dataclass(frozen=True, eq=False, kw_only=True)
class CountedRun:
    """The counts of a run.

    Attributes:
        rollouts: of the policy; ``rollout_seconds`` is their duration, summed over all processes.
        judged: proposals of scenes that passed or failed; ``rejected`` are those of invalid scenes.
        rejected_scenes: distinct invalid scenes; they cost no rollout.
        errors: proposals in which policy or simulator broke.
        failures: in the order in which they were found.
        probability: that the policy fails in a random scene; None where the strategy does not tell.
        certified: None without triage.
    """

    run: Run
    rollouts: int = 0
    rollout_seconds: float = 0.0
    proposals: int = 0
    judged: int = 0
    rejected: int = 0
    rejected_scenes: int = 0
    errors: int = 0
    failures: tuple[Failure, ...] = ()
    probability: Probability | None = None
    certified: Certified | None = None


def quality(severity: float, progress: float, operators: int) -> float:
    """The quality of a failure, in [0, 1]: 1 for a failure in the nominal scene without any progress.

    The mean of two shares: how near to nominal it is (1 - the mean severity of the operators that vary), and
    how early the policy fails (1 - progress).
    """
    return (max(0.0, 1.0 - severity / operators) + 1.0 - progress) / 2.0


def count_run(store: Store, run: Run, embed: Embed) -> CountedRun:
    """Count a stored run.

    Raises:
        UsageError: it reused outcomes of other runs, so that its budget does not compare.
    """
    operators = max(1, len(json.loads(run.manifest.operators).get("varied", ())))
    counts = dict.fromkeys(Verdict, 0)
    failures: dict[str, Failure] = {}
    rejected, own, reused = set[str](), set[str](), set[str]()
    spent, seconds = 0, 0.0
    for trial in store.trials(run.id):
        digest, outcome = trial.scene.digest, trial.outcome
        counts[outcome.verdict] += 1
        (reused if trial.duplicate else own).add(digest)
        if not trial.duplicate:
            spent += len(outcome.rollouts)
            seconds += sum(rollout.seconds for rollout in outcome.rollouts)
        if outcome.verdict is Verdict.INVALID:
            rejected.add(digest)
        if outcome.verdict is Verdict.FAILED and digest not in failures:
            failures[digest] = Failure(
                scene=trial.scene,
                cell=trial.cell or "",
                severity=trial.severity,
                quality=quality(trial.severity, outcome.progress, operators),
                spent=spent,
                vector=embed(trial.scene),
            )
    # A duplicate may precede the trial of its batch that was rolled out, so this waits for all of them.
    if borrowed := len(reused - own):
        raise UsageError(
            f"{store.path}: run {run.id} reused {borrowed} outcomes of other runs, at no cost",
            hint="compare only runs that `vlafuzz compare` did from start to end: give another --store",
        )
    return CountedRun(
        run=run,
        rollouts=spent,
        rollout_seconds=seconds,
        proposals=sum(counts.values()),
        judged=counts[Verdict.PASSED] + counts[Verdict.FAILED],
        rejected=counts[Verdict.INVALID],
        rejected_scenes=len(rejected),
        errors=counts[Verdict.ERROR],
        failures=tuple(failures.values()),
        probability=_probability(store, run, counts),
    )


def _probability(store: Store, run: Run, counts: Mapping[Verdict, int]) -> Probability | None:
    """The strategy's own estimate; independent random scenes give it, too."""
    if found := store.causes(run.id):
        return found.probability
    failed = counts[Verdict.FAILED]
    share = Share.of_counts(failed, failed + counts[Verdict.PASSED])
    random = run.manifest.strategy == "random" and share.of
    return Probability(share.share, share.low, share.high) if random else None


def with_causes(store: Store, runs: Sequence[CountedRun], limit: int) -> list[CountedRun]:
    """The runs with what their triage has come to; as they are with a limit of 0 rollouts."""
    if not limit:
        return list(runs)
    results = known_results(store)
    return [
        replace(one, certified=certified(findings_in_order(store, one.run.id), results, limit))
        for one in runs
    ]


def union(runs: Sequence[CountedRun]) -> dict[str, Failure]:
    """For every cell in which some run failed, its most central failure: the one nearest to their mean.

    One per cell, so that many similar failures do not count for more.
    """
    cells: dict[str, dict[str, Failure]] = {}
    for failure in chain.from_iterable(run.failures for run in runs):
        cells.setdefault(failure.cell, {})[failure.scene.digest] = failure
    central: dict[str, Failure] = {}
    for cell, members in sorted(cells.items()):
        ordered = [members[digest] for digest in sorted(members)]
        points = np.stack([failure.vector for failure in ordered])
        central[cell] = ordered[int(np.linalg.norm(points - points.mean(axis=0), axis=1).argmin())]
    return central
