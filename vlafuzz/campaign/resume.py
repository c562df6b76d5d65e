"""Going on with a run that ended early: which one, and what the store has of it already."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from vlafuzz.errors import StoreError
from vlafuzz.scene import Scene
from vlafuzz.search.base import Proposal
from vlafuzz.store.records import FLAGS, UNFINISHED, Manifest, Run, Trial
from vlafuzz.store.store import Store

Misfit = Callable[[Manifest], str | None]
"""What is other in a manifest than the user asks for, in words; None when it fits."""

_AFRESH = "leave out --resume to start a new run: what is known costs it nothing"
_OF_VERSION = (
    "spec",
    "min_distance",
    "operators_digest",
    "catalogue_digest",
    "simulator",
    "commit",
    "source",
)


def unfinished(store: Store, misfit: Misfit) -> Run:
    """The newest run that ended early and fits.

    Raises:
        StoreError: there is none, or there are several that are not the same run.
    """
    runs = store.runs()
    early = [run for run in runs if run.status in UNFINISHED]
    if not early:
        shown = ", ".join(f"{run.id} {run.status}" for run in runs) or "none yet"
        raise StoreError(f"{store.path}: no run ended early (runs: {shown})", hint=_AFRESH)
    misfits = {run.id: misfit(run.manifest) for run in early}
    fitting = [run for run in early if misfits[run.id] is None]
    if not fitting:
        newest = early[-1].id
        raise StoreError(
            f"{store.path}: no run that ended early fits: run {newest} has {misfits[newest]}",
            hint=f"give the flags of run {newest}, or --store alone to take them from it",
        )
    if len({_about(run.manifest) for run in fitting}) > 1:
        shown = "; ".join(f"run {run.id}: {_told(run.manifest)}" for run in fitting)
        alike = len({_told(run.manifest) for run in fitting}) == 1
        raise StoreError(
            f"{store.path}: {len(fitting)} runs that ended early fit ({shown})",
            hint="give --operators or --vary" if alike else "give those flags in which they differ",
        )
    return fitting[-1]


def check_version(path: object, run: Run, here: Manifest) -> None:
    """That what decides over outcomes is as it was when the run began.

    Raises:
        StoreError: policy, simulator, catalogue or our own code are others now.
    """
    for name in _OF_VERSION:
        was, now = getattr(run.manifest, name), getattr(here, name)
        if was != now:
            values = f" ({was} then, {now} now)" if name != "spec" else ""  # which is as long as a paragraph
            raise StoreError(
                f"{path}: run {run.id} was made by another version: its {name} differs{values}",
                hint=f"go on with the version that began it, or {_AFRESH}",
            )


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
        return StoreError(
            f"{self._corpus.path}: {told}", hint=f"go on with the version that began it, or {_AFRESH}"
        )


def _about(manifest: Manifest) -> tuple[object, ...]:
    return (_told(manifest), manifest.operators_digest)


def _told(manifest: Manifest) -> str:
    """What may tell two runs apart, as the flags that give it."""
    return ", ".join(f"{name} {getattr(manifest, name)}" for name in FLAGS)
