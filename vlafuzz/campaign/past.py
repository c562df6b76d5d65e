"""Past: what a store already has of a run that is resumed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vlafuzz.errors import StoreError
from vlafuzz.scene import Scene
from vlafuzz.search.base import Proposal
from vlafuzz.store.records import Trial
from vlafuzz.store.store import Store

AFRESH = "leave out --resume to start a new run: stored outcomes are reused at no cost"


class Past:
    """What a store has of a run already, handed out batch by batch as its strategy proposes it again.

    Attributes:
        left: trials not yet handed out; 0 for a new run.
    """

    def __init__(self, store: Store, run: int) -> None:
        self._corpus, self._run = store, run
        self.left = store.count(run)

    def take(self, proposals: Sequence[Proposal], scenes: Sequence[Scene]) -> dict[int, Trial]:
        """The stored trials of a batch by their place in it; not all of them where it was cut short.

        Raises:
            StoreError: these are not the proposals that were made then.
        """
        if not self.left:
            return {}
        first = proposals[0].id
        found = {
            trial.proposal - first: trial for trial in self._corpus.stored(self._run, first, len(scenes))
        }
        for index, trial in found.items():
            same = trial.genome is not None and np.array_equal(trial.genome, proposals[index].genome)
            if not same or trial.scene != scenes[index]:
                raise self._diverged(trial.proposal)
        self.left -= len(found)
        if len(found) < len(scenes):
            self.check_empty()
        return found

    def check_empty(self) -> None:
        """That nothing is left which no batch had.

        Raises:
            StoreError: there is.
        """
        if self.left:
            raise self._diverged(self._corpus.count(self._run) - self.left)

    def _diverged(self, proposal: int) -> StoreError:
        told = (
            f"run {self._run} was made by another version: its strategy now gives another proposal {proposal}"
        )
        return StoreError(f"{self._corpus.path}: {told}", hint=f"use the version that began it, or {AFRESH}")
