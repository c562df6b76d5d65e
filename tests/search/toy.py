"""Toy: a closed-form evaluator with planted failures, to test strategies without physics."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from vlafuzz.model import Outcome, Rollout, Scene
from vlafuzz.worlds.tabletop.fairness import check_static
from vlafuzz.worlds.tabletop.objects.catalogue import Catalogue
from vlafuzz.worlds.tabletop.tasks import TASKS

SOONEST, LATEST = 10, 70  # control steps until success, as for real policies at 5 Hz

Signal = Literal["smooth", "flat", "noise"]
Distance = Callable[[Scene], float]
"""How far a scene is from where a condition holds best: 0 there, about 1 at the far end."""


def read(scene: Scene, path: str) -> float | str:
    """A value of a scene, such as ``targets.0.x``; the number of ``confounders``; log2 of the intensity."""
    value: object = scene
    for key in path.split("."):
        value = value[int(key)] if isinstance(value, tuple) else getattr(value, key)
    if isinstance(value, tuple):
        return len(value)
    assert isinstance(value, float | int | str)
    return math.log2(value) if path == "light.intensity" and not isinstance(value, str) else value


def near(path: str, centre: float, span: float, period: float = math.inf) -> Distance:
    """The value is near ``centre``, in units of ``span``; modulo ``period`` for angles."""

    def distance(scene: Scene) -> float:
        offset = abs(float(read(scene, path)) - centre)
        return min(offset % period, -offset % period) / span

    return distance


def among(path: str, names: Sequence[str]) -> Distance:
    return lambda scene: float(read(scene, path) not in names)


def band(weights: Mapping[str, float], centre: float) -> Distance:
    """A weighted sum is near ``centre``: a slab across the space."""
    return lambda scene: abs(sum(w * float(read(scene, path)) for path, w in weights.items()) - centre)


@dataclass(frozen=True)
class Region:
    """The region where the toy policy fails: within ``width`` of all conditions."""

    conditions: tuple[Distance, ...]
    width: float = 0.25

    def distance(self, scene: Scene) -> float:
        """The largest distance of a condition, 0 in the middle of the region."""
        return max(condition(scene) for condition in self.conditions)

    def outside(self, scene: Scene) -> float:
        """Distance of a scene to the region, the mean over the conditions in [0, 1]; 0 inside."""
        excesses = [max(condition(scene) - self.width, 0.0) for condition in self.conditions]
        return min(sum(excesses) / len(excesses), 1.0)

    def calibrated(self, scenes: Sequence[Scene], share: float) -> Region:
        """The region with the width at which this share of the scenes fails."""
        distances = [self.distance(scene) for scene in scenes]
        return replace(self, width=float(np.quantile(distances, share)))


class Toy:
    """A policy that fails in a region and succeeds elsewhere.

    With a ``smooth`` signal, success is later the nearer a scene is to the region, and failure is earlier the deeper a
    scene is inside. With a ``flat`` signal, all successes are alike, and so are all failures. With ``noise``, time of
    success and progress are random.
    """

    def __init__(self, region: Region, catalogue: Catalogue, *, min_distance: float, signal: Signal = "smooth") -> None:
        self._region, self._catalogue = region, catalogue
        self._min_distance, self._signal = min_distance, signal

    def evaluate(self, scenes: Sequence[Scene]) -> list[Outcome]:
        return [self._outcome(scene) for scene in scenes]

    def close(self) -> None:
        """Nothing to close."""

    def _outcome(self, scene: Scene) -> Outcome:
        rejection = check_static(scene, self._catalogue, self._min_distance)
        if rejection is not None:
            return Outcome.invalid(rejection.check, rejection.reason)
        stages, distance = TASKS[scene.task].stage_names, self._region.distance(scene)
        fails = distance <= self._region.width
        depth = distance / (self._region.width or 1.0) if fails else self._region.outside(scene)
        signal = {"smooth": depth, "flat": 0.5, "noise": int(scene.digest[:8], 16) / 16**8}[self._signal]
        if fails:
            progress, steps = 0.9 * signal, LATEST
            reached = stages[: int(progress * len(stages))]
        else:
            progress, steps, reached = 1.0, LATEST - round(signal * (LATEST - SOONEST)), stages
        return Outcome.of((_rollout(scene, progress, steps, reached, success=not fails),), stages)


def _rollout(scene: Scene, progress: float, steps: int, reached: tuple[str, ...], *, success: bool) -> Rollout:
    trace = np.append(np.linspace(0, min(progress, 0.99), steps - 1), progress).astype(np.float32)
    made: dict[str, Any] = {"actions": np.zeros((steps, 7), dtype=np.float32), "states_hash": scene.digest}
    made |= {"success_once": success, "success_at_end": success, "reached": reached, "seconds": 0.0}
    return Rollout(progress=progress, trace=trace, **made)
