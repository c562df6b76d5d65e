"""What a run found, as a comparison needs it: each failing scene once, and when in the run it was found."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from vlafuzz.campaign.clusters import Embed
from vlafuzz.errors import UsageError
from vlafuzz.outcome import Verdict
from vlafuzz.scene import Scene
from vlafuzz.store.records import Run
from vlafuzz.store.store import Store

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Failure:
    """A failing scene of a run.

    Attributes:
        cell: where it lies, see ``scoring.cell``.
        severity: its distance from nominal, the sum over the operators.
        quality: how near to nominal and how early it fails, see ``quality``.
        spent: rollouts of the run when it was found, its own included.
        vector: the scene, where distance means difference.
    """

    scene: Scene
    cell: str
    severity: float
    quality: float
    spent: int
    vector: Vector


@dataclass(frozen=True, eq=False)
class CountedRun:
    """A run, counted.

    Attributes:
        rollouts: of the policy; ``rollout_seconds`` is what they took, added up over all processes.
        judged: proposals of scenes that passed or failed, ``rejected`` of scenes that are not fair.
        rejected_scenes: distinct ones; they cost no rollout.
        errors: proposals in which policy or simulator broke.
        failures: in the order in which they were found.
    """

    run: Run
    rollouts: int = 0
    rollout_seconds: float = 0.0
    proposals: int = 0
    judged: int = 0
    rejected: int = 0
    rejected_scenes: int = 0
    errors: int = 0
    failures: tuple[Failure, ...] = field(default=())

    @property
    def strategy(self) -> str:
        """That proposed its scenes."""
        return self.run.manifest.strategy


def quality(severity: float, progress: float, operators: int) -> float:
    """What a failure is worth, in [0, 1]: 1 for one in the nominal scene, before anything was achieved.

    The mean of two shares: how near to nominal it is (1 - the mean severity of the operators that vary), and
    how early the policy fails (1 - progress).
    """
    return (max(0.0, 1.0 - severity / operators) + 1.0 - progress) / 2.0


def count_run(store: Store, run: Run, embed: Embed) -> CountedRun:
    """Count what a store has of a run.

    Raises:
        UsageError: other runs answered for it, so that it did not pay for what it learned.
    """
    operators = max(1, len(json.loads(run.manifest.operators).get("varied", ())))
    counts = dict.fromkeys(Verdict, 0)
    failures: dict[str, Failure] = {}
    rejected, own = set[str](), set[str]()
    spent, seconds, proposals = 0, 0.0, 0
    # In the order of proposals, a known scene may come before the trial of its batch that rolled it out.
    borrowed: dict[str, int] = {}
    for trial in store.trials(run.id):
        digest, outcome = trial.scene.digest, trial.outcome
        proposals += 1
        counts[outcome.verdict] += 1
        if trial.duplicate:
            borrowed.setdefault(digest, trial.proposal)
        else:
            own.add(digest)
            spent += len(outcome.rollouts)
            seconds += sum(rollout.seconds for rollout in outcome.rollouts)
        if outcome.verdict is Verdict.INVALID:
            rejected.add(digest)
        if outcome.verdict is Verdict.FAILED and digest not in failures:
            worth = quality(trial.severity, outcome.progress, operators)
            failures[digest] = Failure(
                trial.scene, trial.cell or "", trial.severity, worth, spent, embed(trial.scene)
            )
    _check_own(store, run, [borrowed[digest] for digest in borrowed if digest not in own])
    judged = counts[Verdict.PASSED] + counts[Verdict.FAILED]
    return CountedRun(
        run, spent, seconds, proposals, judged, counts[Verdict.INVALID], len(rejected),
        counts[Verdict.ERROR], tuple(failures.values()),
    )  # fmt: skip


def _check_own(store: Store, run: Run, borrowed: Sequence[int]) -> None:
    if borrowed:
        raise UsageError(
            f"{store.path}: run {run.id} was answered {len(borrowed)} scenes by other runs, at no cost",
            hint="compare runs that `vlafuzz compare` began, and that it went on with: give another --store",
        )


def union(found: Sequence[CountedRun]) -> dict[str, Failure]:
    """Of every cell in which some run failed, its most central failure: the one nearest to their mean.

    One a cell, so that many failures that resemble each other do not count for more.
    """
    cells: dict[str, dict[str, Failure]] = {}
    for failure in chain.from_iterable(each.failures for each in found):
        cells.setdefault(failure.cell, {})[failure.scene.digest] = failure
    central: dict[str, Failure] = {}
    for cell, members in sorted(cells.items()):
        ordered = [members[digest] for digest in sorted(members)]
        points = np.stack([failure.vector for failure in ordered])
        central[cell] = ordered[int(np.linalg.norm(points - points.mean(axis=0), axis=1).argmin())]
    return central
