"""Spaces, planted failures and campaigns without a store, for tests of strategies."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Any, ClassVar

import numpy as np

from tests.search.toy import Region, Signal, Toy, near
from vlafuzz.model import Outcome, Scene
from vlafuzz.search.base import Strategy
from vlafuzz.search.scoring import Score, score
from vlafuzz.worlds.tabletop.objects import load_catalogue
from vlafuzz.worlds.tabletop.space import SearchSpace, load_operators

CATALOGUE = load_catalogue()
EASY = Region((near("light.intensity", -4.3, 8.6), near("camera.yaw", 5.0, 10.0)))


class Remembering(SearchSpace):
    """Draws each random scene once for all tests of a process: strategies draw the same hundreds for every seed."""

    drawn: ClassVar[dict[tuple[str, ...], tuple[Scene, Any]]] = {}

    def sample(self, rng: np.random.Generator) -> Scene:
        of = self.task.name, self.rig.robot, self.operators.digest, self.catalogue.digest
        began = *of, str(rng.bit_generator.state)
        if began not in self.drawn:
            self.drawn[began] = super().sample(rng), rng.bit_generator.state
        scene, rng.bit_generator.state = self.drawn[began]
        return scene


@cache
def space(task: str = "pick-up", *vary: str) -> SearchSpace:
    """Also with scenes in which the target is not seen: to tell them apart takes longer than all the rest."""
    operators = replace(load_operators(), visible=None)
    return Remembering(operators.only(vary) if vary else operators, CATALOGUE, task)


@cache
def sampled(count: int, task: str = "pick-up") -> tuple[Scene, ...]:
    return tuple(space(task).sample(np.random.default_rng([7, index])) for index in range(count))


def toy(region: Region = EASY, share: float = 0.05, signal: Signal = "smooth") -> Toy:
    """Where that share of generated scenes fails."""
    return Toy(region.calibrated(sampled(1000), share), CATALOGUE, min_distance=0.15, signal=signal)


def judged(evaluator: Toy, scenes: Sequence[Scene], where: SearchSpace) -> list[Score]:
    outcomes: list[Outcome] = evaluator.evaluate(scenes)
    return [score(scene, outcome, where) for scene, outcome in zip(scenes, outcomes, strict=True)]


def failures(strategy: Strategy, evaluator: Toy, budget: int, batch: int = 16) -> set[str]:
    """Digests of the failing scenes among so many proposals."""
    found = set()
    for first in range(0, budget, batch):
        proposals = strategy.ask(min(batch, budget - first))
        scenes = [space().decode(proposal.genome) for proposal in proposals]
        scores = judged(evaluator, scenes, space())
        found |= {scene.digest for scene, told in zip(scenes, scores, strict=True) if told.failed}
        strategy.tell(proposals, scores)
    return found
