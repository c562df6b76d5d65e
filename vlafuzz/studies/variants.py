"""Variants: scenes that a study derives from those of a run, and what came of them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from vlafuzz.outcome import Outcome, Verdict
from vlafuzz.scene import Scene
from vlafuzz.store.records import Run, Trial
from vlafuzz.store.store import Store

JUDGED = (Verdict.PASSED, Verdict.FAILED)


class Variant(NamedTuple):
    """A scene made of the ``origin``-th scene of a run; ``arm`` says what was done to it."""

    scene: Scene
    origin: int
    arm: str


class Tried(NamedTuple):
    """A variant with what came of it."""

    variant: Variant
    outcome: Outcome

    @property
    def judged(self) -> bool:
        """Whether it passed or failed: an error is no failure, an unfair scene neither."""
        return self.outcome.verdict in JUDGED

    @property
    def passed(self) -> bool:
        """Whether all its rollouts succeeded."""
        return self.outcome.verdict is Verdict.PASSED


def pooled(every: Iterable[Sequence[Tried]]) -> list[Tried]:
    """Those of several runs together, with origins of their own."""
    made: list[Tried] = []
    for found in every:
        first = 1 + max((each.variant.origin for each in made), default=-1)
        made += [
            Tried(each.variant._replace(origin=first + each.variant.origin), each.outcome) for each in found
        ]
    return made


def distinct(store: Store, run: Run) -> list[Trial]:
    """The trials of a run, without those that were answered with the outcome of another one."""
    return [trial for trial in store.trials(run.id) if not trial.duplicate]


def tried(store: Store, run: Run | None, variants: Sequence[Variant]) -> list[Tried]:
    """What came of variants in their run, which proposed them in order; nothing without one."""
    found = store.stored(run.id, 0, len(variants)) if run else []
    return [Tried(variants[trial.proposal], trial.outcome) for trial in found]
