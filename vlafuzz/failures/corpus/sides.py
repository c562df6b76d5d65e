"""Sides of a comparison: a policy that is rolled out, or what is known of one, scene by scene."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Protocol

from vlafuzz.failures.corpus.controls import REGRESS, number_of
from vlafuzz.failures.corpus.pairs import Probe
from vlafuzz.model.outcome import Outcome, Verdict
from vlafuzz.model.scene import Scene
from vlafuzz.rollouts.scene_runner import SceneRunner
from vlafuzz.store.records import Manifest

Asked = tuple[Probe, int]  # a scene, and the number of a rollout in it


class Side(Protocol):
    """One of the two policies that are compared."""

    @property
    def name(self) -> str: ...

    def answers(self, asked: Sequence[Asked]) -> Iterator[Outcome]:
        """The outcome of each rollout, as it is taken."""


@dataclass(frozen=True)
class Recorded:
    """A baseline without rollouts: the corpus's records of its own policy."""

    name: str

    def answers(self, asked: Sequence[Asked]) -> Iterator[Outcome]:
        """The recorded verdicts."""
        return (Outcome(verdict=Verdict.PASSED if probe.passed else Verdict.FAILED) for probe, _ in asked)


class Rerun:
    """A policy that is rolled out now, with one runner for all runs under the same conditions.

    Args:
        runs: of the corpus.
        make: makes the runner for the conditions of a run; called with the run's manifest at seed 0.
    """

    def __init__(self, name: str, runs: Sequence[Manifest], make: Callable[[Manifest], SceneRunner]) -> None:
        self.name, self._runs = name, runs
        distinct = {run.key(seeded=False): replace(run, seed=0) for run in runs}
        self._runners = {key: make(run) for key, run in distinct.items()}

    def answers(self, asked: Sequence[Asked]) -> Iterator[Outcome]:
        """Rollouts, as many at a time as the runner has lanes."""
        for key, group in groupby(asked, lambda one: self._runs[one[0].run].key(seeded=False)):
            runner, some = self._runners[key], list(group)
            size = getattr(runner, "lanes", 1)
            for first in range(0, len(some), size):
                scenes, numbers = zip(*(self._rollout(runner, *one) for one in some[first : first + size]), strict=True)
                yield from runner.evaluate(scenes, numbers)

    def _rollout(self, runner: SceneRunner, probe: Probe, repeat: int) -> tuple[Scene, int]:
        """A control as it is, another scene with a jitter and seed of no other use."""
        scene, number = probe.scene, number_of(probe.scene)
        if probe.group != "control":
            number = number_of(scene, REGRESS, repeat)
            scene = runner.space.jittered(scene, number)
        return scene, self._runs[probe.run].seed + number

    def close(self) -> None:
        for runner in self._runners.values():
            runner.close()
