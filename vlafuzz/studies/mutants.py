"""RQ3 and RQ4: how many of the scenes that a policy passed it still passes under other light or camera."""

from __future__ import annotations

import math
from bisect import bisect
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

import numpy as np

from vlafuzz.errors import UsageError
from vlafuzz.outcome import Verdict
from vlafuzz.scene import Scene
from vlafuzz.space import OperatorSet, SearchSpace
from vlafuzz.space.operators import CameraOrientation, CameraPosition, Light
from vlafuzz.statistics import Share
from vlafuzz.studies.variants import Tried, Variant

Alpha = Literal["linear", "log"]
MUTANTS = 3  # per scene, as in the paper
CONTROL, MUTANT, ALL = "control", "mutant", "all"
MUTATED = {"rq3": (Light.name,), "rq4": (CameraPosition.name, CameraOrientation.name)}
_REDRAWS = 100
EDGES = {  # of the bins of a curve; values beyond the last edge belong to the last bin
    "darker": (1, 2, 4, 8, 20),
    "brighter": (1, 2, 4, 8, 20),
    "camera moved, cm": (0, 1, 2, 3, 4, 5),
    "camera turned, degrees": (0, 2, 4, 6, 9),
}
CURVES = {"rq3": ("darker", "brighter"), "rq4": ("camera moved, cm", "camera turned, degrees")}


@dataclass(frozen=True, kw_only=True)
class Kept:
    """How many scenes of a task a policy still passes when they are mutated, of those that it had passed.

    Attributes:
        task: ``all`` for all tasks together.
        default: scenes that it had passed.
        control: the share of these passed again, unmutated, with the seed of the mutants.
        mutated: the share of their mutants passed.
        invalid, errors: mutants and controls, left out of both shares.
    """

    task: str
    policy: str
    default: int
    control: Share
    mutated: Share
    invalid: int
    errors: int

    @property
    def mean(self) -> float:
        """The paper's Mut.: how many of the scenes are passed when each is mutated, on average."""
        return self.mutated.share * self.default


@dataclass(frozen=True)
class Point:
    """The share passed of the mutants of all tasks that are off nominal by ``low`` to ``high``."""

    policy: str
    curve: str
    low: float
    high: float
    passed: Share


def mutating(study: str, operators: OperatorSet, alpha: Alpha) -> OperatorSet:
    """The operators, of which only the study's vary: light as drawn in the paper, or evenly in log2."""
    light = operators.get(Light).model_copy(update={"spread": "coin" if alpha == "linear" else "even"})
    return replace(operators, operators={**operators.operators, Light.name: light}).only(MUTATED[study])


def mutants(space: SearchSpace, scenes: Sequence[Scene], seed: int) -> list[Variant]:
    """Each scene unmutated, then ``MUTANTS`` distinct mutants of it, in which the space's operators vary.

    Raises:
        UsageError: the ranges leave no room for so many.
    """
    variants: list[Variant] = []
    for origin, scene in enumerate(scenes):
        rng = np.random.default_rng([seed, int(scene.digest, 16)])  # a scene's mutants suit all policies
        variants.append(Variant(scene, origin, CONTROL))
        variants += [Variant(mutant, origin, MUTANT) for mutant in _draws(space, scene, rng)]
    return variants


def kept(task: str, policy: str, tried: Sequence[Tried]) -> Kept:
    """Count the outcomes of scenes that a policy had passed, and of their mutants."""
    verdicts, controls = [result.outcome.verdict for result in tried], _judged(tried, CONTROL)
    return Kept(
        task=task,
        policy=policy,
        default=sum(result.variant.arm == CONTROL for result in tried),
        control=Share.of_counts(sum(result.passed for result in controls), len(controls)),
        mutated=_share(_judged(tried, MUTANT)),
        invalid=verdicts.count(Verdict.INVALID),
        errors=verdicts.count(Verdict.ERROR),
    )


def points(study: str, policy: str, tried: Sequence[Tried]) -> list[Point]:
    """The curves of a study: the share of mutants passed, by their distance from nominal."""
    points = []
    for curve in CURVES[study]:
        edges = EDGES[curve]
        bins: list[list[Tried]] = [[] for _ in edges[1:]]
        for result in _judged(tried, MUTANT):
            if (distance := _distance(curve, result.variant.scene)) is not None:
                bins[bisect(edges[1:-1], distance)].append(result)
        spans = zip(pairwise(edges), bins, strict=True)
        points += [Point(policy, curve, *span, _share(inside)) for span, inside in spans if inside]
    return points


def _draws(space: SearchSpace, scene: Scene, rng: np.random.Generator) -> list[Scene]:
    values, drawn = space.values(scene), {scene: None}
    for _ in range(_REDRAWS):
        changed = values | {gene.path: gene.draw(rng) for gene in space.genes}
        drawn[space.composer.compose(changed)] = None
        if len(drawn) > MUTANTS:
            return list(drawn)[1:]
    names = ", ".join(sorted(space.operators.varied))
    raise UsageError(f"{names}: the ranges hold no {MUTANTS} mutants of a scene", hint="widen them")


def _judged(tried: Sequence[Tried], arm: str) -> list[Tried]:
    return [result for result in tried if result.variant.arm == arm and result.judged]


def _share(mutants: Sequence[Tried]) -> Share:
    return Share.grouped([(result.variant.origin, result.passed) for result in mutants])


def _distance(curve: str, scene: Scene) -> float | None:
    """The distance of a mutant from nominal along a curve; None where it is on the other side."""
    light, camera = scene.light.intensity, scene.camera
    if curve == "darker":
        return 1 / light if light < 1 else None
    if curve == "brighter":
        return light if light > 1 else None
    if curve.startswith("camera moved"):
        return 100 * camera.distance
    return math.hypot(camera.roll, camera.pitch, camera.yaw)
