"""Past: the stored trials of a run that is resumed, handed out as its strategy proposes them again."""

from collections.abc import Sequence

import numpy as np

from vlafuzz.errors import StoreError
from vlafuzz.model.scene import Scene
from vlafuzz.search.base import Proposal
from vlafuzz.store.records import Trial
from vlafuzz.store.store import Store

AFRESH = "leave out --resume to start a new run: stored outcomes are reused at no cost"


class Past:
    """Hands out a run's stored trials, as its strategy proposes them again.

    Attributes:
        left: trials not yet handed out; 0 for a new run.
    """

    def __init__(self, store: Store, run: int) -> None:
        self._store, self._run = store, run
        self.left = store.count(run)
        self._last = store.last_proposal(run) if self.left else -1

    def take(self, proposals: Sequence[Proposal], scenes: Sequence[Scene]) -> dict[int, Trial]:
        """The stored trials of these proposals by index; those that were in progress are missing."""
        if not self.left:
            return {}
        first = proposals[0].id
        stored = self._store.stored(self._run, first, len(scenes))
        trials = {trial.proposal - first: trial for trial in stored}
        for index, trial in trials.items():
            same = trial.genome is not None and np.array_equal(trial.genome, proposals[index].genome)
            if not same or trial.scene != scenes[index]:
                raise self._diverged(trial.proposal)
        self.left -= len(trials)
        if proposals[-1].id >= self._last:
            self.check_empty()
        return trials

    def check_empty(self) -> None:
        """Raise a StoreError if a stored trial was not handed out."""
        if self.left:
            raise self._diverged(self._store.count(self._run) - self.left)

    def _diverged(self, proposal: int) -> StoreError:
        problem = f"was made by another version: its strategy now differs at proposal {proposal}"
        hint = f"use the version that began it, or {AFRESH}"
        return StoreError(f"{self._store.path}: run {self._run} {problem}", hint)
