"""Variants: scenes that a study derives from those of a run, and their outcomes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from vlafuzz.outcome import Outcome, Verdict
from vlafuzz.scene import Scene
from vlafuzz.store.records import Run, Trial
from vlafuzz.store.store import Store

JUDGED = (Verdict.PASSED, Verdict.FAILED)


class Variant(NamedTuple):
    """A scene derived from the ``origin``-th scene of a run; ``arm`` says how."""

    scene: Scene
    origin: int
    arm: str


class Tried(NamedTuple):
    """A variant with its outcome."""

    variant: Variant
    outcome: Outcome

    @property
    def judged(self) -> bool:
        """Whether it passed or failed: neither an error nor an invalid scene is a failure."""
        return self.outcome.verdict in JUDGED

    @property
    def passed(self) -> bool:
        """Whether all its rollouts succeeded."""
        return self.outcome.verdict is Verdict.PASSED


def pooled(runs: Iterable[Sequence[Tried]]) -> list[Tried]:
    """The variants of several runs together, with distinct origins."""
    pool: list[Tried] = []
    for run in runs:
        first = 1 + max((variant.origin for variant, _ in pool), default=-1)
        pool += [Tried(variant._replace(origin=first + variant.origin), outcome) for variant, outcome in run]
    return pool


def distinct(store: Store, run: Run) -> list[Trial]:
    """The trials of a run, without those that reused an outcome."""
    return [trial for trial in store.trials(run.id) if not trial.duplicate]


def tried(store: Store, run: Run | None, variants: Sequence[Variant]) -> list[Tried]:
    """Variants with their outcomes in a run that proposed them in order; none without a run."""
    trials = store.stored(run.id, 0, len(variants)) if run else []
    return [Tried(variants[trial.proposal], trial.outcome) for trial in trials]
