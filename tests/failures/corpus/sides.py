"""Sides of a comparison without a simulator, and corpora of any size."""

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from tests.doubles import failed, passed, scene
from vlafuzz.failures.corpus.pairs import Group, Probe
from vlafuzz.failures.corpus.regress import Asked
from vlafuzz.model import Outcome, Scene, Verdict
from vlafuzz.store.records import Manifest
from vlafuzz.worlds.tabletop.objects import load_catalogue
from vlafuzz.worlds.tabletop.space import SearchSpace, load_operators

NO_VERDICT = {Verdict.ERROR: Outcome.error("policy: connect"), Verdict.INVALID: Outcome.invalid("x", "unfair")}


def probes(controls: int = 60, failing: int = 0) -> list[Probe]:
    """Controls, each fifth of which failed; then failing scenes. The target's x holds the number of the scene."""

    def probe(number: int, group: Group, passed: bool) -> Probe:
        return Probe(scene(x=number / 1000), group, f"{group} {number}", 0, passed)

    random = [probe(number, "control", passed=number % 5 > 0) for number in range(controls)]
    return random + [probe(controls + number, "failing", passed=False) for number in range(failing)]


class Planned:
    """Answers by a rule, and records its calls: a scene's number and the repeat."""

    def __init__(self, rule: Callable[[int, int], Verdict | bool], *, name: str = "new") -> None:
        self.name, self._rule = name, rule
        self.calls: list[tuple[int, int]] = []

    def answers(self, asked: Sequence[Asked]) -> Iterator[Outcome]:
        return (self.answer(*one) for one in asked)

    def answer(self, probe: Probe, repeat: int) -> Outcome:
        number = round(probe.scene.targets[0].x * 1000)
        self.calls.append((number, repeat))
        result = self._rule(number, repeat)
        if isinstance(result, Verdict):
            return NO_VERDICT[result]
        return passed() if result else failed()


def flaky(rate: float, rng: np.random.Generator, name: str = "flaky") -> Planned:
    """Fails at random, whatever the seed."""
    return Planned(lambda number, repeat: bool(rng.random() >= rate), name=name)


class RuleRunner:
    """A runner whose policy passes in the scenes that a rule names; records seeds."""

    changed: tuple[str, ...] = ()
    elsewhere = ""
    renderer: str | None = None
    space = SearchSpace(load_operators(), load_catalogue(), "pick-up")

    def __init__(self, rule: Callable[[Scene], bool], run: Manifest, *, deterministic: bool = True) -> None:
        self._rule, self.run, self.deterministic = rule, run, deterministic
        self.calls: list[tuple[Scene, int]] = []
        self.closed = 0

    def evaluate(self, scenes: Sequence[Scene], numbers: Sequence[int]) -> list[Outcome]:
        self.calls += [(scene, number + self.run.seed) for scene, number in zip(scenes, numbers, strict=True)]
        return [passed() if self._rule(scene) else failed() for scene in scenes]

    def close(self) -> None:
        self.closed += 1
