"""Runs that are cut, and what they left."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.doubles import ClosedForm, Raising, TinySpace, manifest
from vlafuzz.campaign.fuzz import Campaign
from vlafuzz.campaign.tally import Summary
from vlafuzz.model import Outcome, Scene
from vlafuzz.rollouts.executor import LocalExecutor
from vlafuzz.search.base import Proposal
from vlafuzz.search.scoring import Score
from vlafuzz.store.records import Trial
from vlafuzz.store.store import Store

SPACE = TinySpace()
ABOUT = manifest(budget=30, batch=7)


class Climber:
    """Six scenes a generation, near the one nearest to failing so far; asked for in any portions."""

    def __init__(self, seed: int = 0) -> None:
        self._seed, self._asked, self._best, self._ease = seed, 0, np.full(3, 0.5), np.inf
        self._generation: list[tuple[Score, Proposal]] = []

    def ask(self, n: int) -> list[Proposal]:
        n = min(n, 6 - self._asked % 6)
        first, self._asked = self._asked, self._asked + n
        return [Proposal(number, self._near(number)) for number in range(first, self._asked)]

    def tell(self, proposals: Sequence[Proposal], scores: Sequence[Score]) -> None:
        self._generation += zip(scores, proposals, strict=True)
        if len(self._generation) == 6:
            score, proposal = min(self._generation, key=lambda pair: (pair[0].ease, pair[1].id))
            if score.ease <= self._ease:
                self._best, self._ease = proposal.genome, score.ease
            self._generation = []

    def _near(self, number: int) -> np.ndarray:
        step = np.random.default_rng([self._seed, number]).normal(0, 0.2, 3)
        return np.clip(self._best + step, 0, 1 - 1e-9)


class Steady(Climber):
    """The same, asked while outcomes are outstanding."""

    outstanding = 7


class Moody(ClosedForm):
    """Errors on every fifth scene, by its digest."""

    def outcome(self, scene: Scene) -> Outcome:
        return Outcome.error("no answer") if int(scene.digest, 16) % 5 == 0 else super().outcome(scene)


def play(path: Path, *, resume: int | None = None, about=ABOUT, **parts) -> Summary:
    defaults = {"strategy": Climber(), "executor": LocalExecutor(Moody()), "patience": None}
    with Store.open(path, "write") as store:
        return Campaign(manifest=about, space=SPACE, store=store, resume=resume, **defaults | parts).run()


class Cut(Raising, Moody):
    """Raises after so many scenes."""


def cut(path: Path, after: int, executor=LocalExecutor, **parts) -> None:
    """A run that Ctrl-C ends after so many scenes."""
    with pytest.raises(KeyboardInterrupt):
        play(path, executor=executor(Cut(KeyboardInterrupt(), after)), **parts)


def contents(path: Path, run: int = 1) -> tuple[object, ...]:
    """All that a run left, but for times."""

    def told(one: Trial) -> tuple[object, ...]:
        genome = one.genome.tobytes() if one.genome is not None else None
        ended = one.outcome.verdict, one.outcome.progress, len(one.outcome.rollouts)
        return one.proposal, one.scene, *ended, genome, one.cell, one.duplicate

    with Store.open(path) as store:
        trials = list(map(told, store.trials(run)))
        (status,) = [each.status for each in store.runs() if each.id == run]
        return trials, store.findings(run), status


def timeless(summary: Summary, path: Path) -> Summary:
    return replace(summary, seconds=0.0, store=str(path))
