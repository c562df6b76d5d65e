"""RQ3 and RQ4: how many of the scenes that a policy passed it still passes with other light or camera."""

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
EACH = 3  # mutants of a scene, as in the paper
CONTROL, MUTANT, ALL = "control", "mutant", "all"
MUTATED = {"rq3": (Light.name,), "rq4": (CameraPosition.name, CameraOrientation.name)}
_REDRAWS = 100
EDGES = {  # of the bins of a curve; what is beyond the last one belongs to the last bin
    "darker": (1, 2, 4, 8, 20),
    "brighter": (1, 2, 4, 8, 20),
    "camera moved, cm": (0, 1, 2, 3, 4, 5),
    "camera turned, degrees": (0, 2, 4, 6, 9),
}
CURVES = {"rq3": ("darker", "brighter"), "rq4": ("camera moved, cm", "camera turned, degrees")}


@dataclass(frozen=True)
class Kept:
    """What a policy still passes of the scenes of a task that it had passed.

    Attributes:
        task: ``all`` for all tasks together.
        default: scenes that it had passed.
        control: of these scenes, run once more as they are in the seed of the mutants.
        mutated: of their mutants.
        invalid, errors: mutants and controls that are left out of both shares.
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
        """The paper's Mut.: how many of the scenes are passed with a mutant each, on average."""
        return self.mutated.share * self.default


@dataclass(frozen=True)
class Point:
    """Mutants of a policy, in all tasks, that are off nominal by ``low`` to ``high``, and were passed."""

    policy: str
    curve: str
    low: float
    high: float
    passed: Share


def mutating(study: str, operators: OperatorSet, alpha: Alpha) -> OperatorSet:
    """The operators with only those varied that mutate: light by the paper's coin, or evenly in log2."""
    light = operators.get(Light).model_copy(update={"spread": "coin" if alpha == "linear" else "even"})
    return replace(operators, operators={**operators.operators, Light.name: light}).only(MUTATED[study])


def mutants(space: SearchSpace, scenes: Sequence[Scene], seed: int) -> list[Variant]:
    """Each scene as it is, then ``EACH`` mutants of it: draws of what the space varies, no two alike.

    Raises:
        UsageError: the ranges leave no room for so many.
    """
    made: list[Variant] = []
    for origin, scene in enumerate(scenes):
        rng = np.random.default_rng([seed, int(scene.digest, 16)])  # of a scene, the same for all policies
        made.append(Variant(scene, origin, CONTROL))
        made += [Variant(each, origin, MUTANT) for each in _draws(space, scene, rng)]
    return made


def kept(task: str, policy: str, found: Sequence[Tried]) -> Kept:
    """Count what came of the scenes that a policy had passed, and of their mutants."""
    verdicts, controls = [each.outcome.verdict for each in found], _of(found, CONTROL)
    return Kept(
        task=task,
        policy=policy,
        default=sum(each.variant.arm == CONTROL for each in found),
        control=Share.of_counts(sum(each.passed for each in controls), len(controls)),
        mutated=_share(_of(found, MUTANT)),
        invalid=verdicts.count(Verdict.INVALID),
        errors=verdicts.count(Verdict.ERROR),
    )


def points(study: str, policy: str, found: Sequence[Tried]) -> list[Point]:
    """The curves of a study: the share of mutants passed, by how far off nominal they are."""
    made = []
    for curve in CURVES[study]:
        edges = EDGES[curve]
        bins: list[list[Tried]] = [[] for _ in edges[1:]]
        for each in _of(found, MUTANT):
            if (off := _off(curve, each.variant.scene)) is not None:
                bins[bisect(edges[1:-1], off)].append(each)
        spans = zip(pairwise(edges), bins, strict=True)
        made += [Point(policy, curve, *span, _share(inside)) for span, inside in spans if inside]
    return made


def _draws(space: SearchSpace, scene: Scene, rng: np.random.Generator) -> list[Scene]:
    values, drawn = space.values(scene), {scene: None}
    for _ in range(_REDRAWS):
        changed = values | {gene.path: gene.draw(rng) for gene in space.genes}
        drawn[space.composer.compose(changed)] = None
        if len(drawn) > EACH:
            return list(drawn)[1:]
    names = ", ".join(sorted(space.operators.varied))
    raise UsageError(f"{names}: the ranges hold no {EACH} mutants of a scene", hint="widen them")


def _of(found: Sequence[Tried], arm: str) -> list[Tried]:
    return [each for each in found if each.variant.arm == arm and each.judged]


def _share(found: Sequence[Tried]) -> Share:
    return Share.grouped([(each.variant.origin, each.passed) for each in found])


def _off(curve: str, scene: Scene) -> float | None:
    """How far a mutant is off nominal along a curve; None where it is on the other side."""
    light, camera = scene.light.intensity, scene.camera
    if curve == "darker":
        return 1 / light if light < 1 else None
    if curve == "brighter":
        return light if light > 1 else None
    if curve.startswith("camera moved"):
        return 100 * camera.distance
    return math.hypot(camera.roll, camera.pitch, camera.yaw)
