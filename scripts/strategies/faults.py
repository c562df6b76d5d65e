"""Worlds: policies with several planted faults whose conditions and prevalence are known, without physics.

A fault holds where one to three conditions hold together; prevalence is its share of random scenes. Faults may overlap.
Outside of them the policy passes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tests.search.toy import Signal
from vlafuzz.model import Outcome, Rollout, Scene
from vlafuzz.worlds.tabletop.fairness import check_static
from vlafuzz.worlds.tabletop.objects import load_catalogue
from vlafuzz.worlds.tabletop.space import SearchSpace, load_operators
from vlafuzz.worlds.tabletop.tasks import TASKS

SAMPLES = 10_000  # random scenes that prevalence is measured with: ten of them lie in the rarest fault
SOONEST, LATEST = 10, 70  # control steps until success
DENSITIES = {"dense": 0.5, "middling": 0.15, "sparse": 0.05, "very sparse": 0.01}  # share that fails
RAREST = 0.001
MOST_SHARED = 0.5  # of the scenes of the rarer of two faults
TRIES = 400

Table = Mapping[str, NDArray[np.float64]]  # values of many scenes by path; NaN where a scene has none
Density = Literal["dense", "middling", "sparse", "very sparse"]
Rng = np.random.Generator


@dataclass(frozen=True)
class Condition:
    """A value lies in a range, or is one of some options; paths as in ``values_of``."""

    path: str
    low: float = -math.inf
    high: float = math.inf
    options: frozenset[int] = frozenset()

    def holds(self, table: Table) -> NDArray[np.bool_]:
        """``(n,)`` where it holds; never for a value that a scene lacks."""
        values = table[self.path]
        if self.options:
            return np.isin(values, list(self.options))
        with np.errstate(invalid="ignore"):
            return np.asarray((values >= self.low) & (values <= self.high))

    def margin(self, values: Mapping[str, float], spans: Mapping[str, float]) -> float:
        """How far a value is from holding, as a share of its range: 0 where it holds."""
        value = values[self.path]
        if self.options or math.isnan(value):
            return float(value not in self.options)
        return max(self.low - value, value - self.high, 0.0) / spans[self.path]

    def __str__(self) -> str:
        if self.options:
            return f"{self.path} in {sorted(self.options)}"
        if math.isinf(self.high):
            return f"{self.path} >= {self.low:.3g}"
        if math.isinf(self.low):
            return f"{self.path} <= {self.high:.3g}"
        return f"{self.low:.3g} <= {self.path} <= {self.high:.3g}"


@dataclass(frozen=True)
class Fault:
    """Conditions that make the policy lose a stage where they hold together."""

    conditions: tuple[Condition, ...]
    stage: int = 0

    def holds(self, table: Table) -> NDArray[np.bool_]:
        """``(n,)`` where all conditions hold."""
        return np.asarray(np.logical_and.reduce([condition.holds(table) for condition in self.conditions]))

    @property
    def operators(self) -> frozenset[str]:
        """The groups of operators that it takes: those whose nominal value does not meet a condition."""
        nominal = _nominal()
        taken = [condition for condition in self.conditions if not condition.holds(nominal)[0]]
        return frozenset().union(*(_GROUPS[condition.path] for condition in taken))

    def __str__(self) -> str:
        return " and ".join(map(str, self.conditions))


@dataclass(frozen=True)
class World:
    """A policy with planted faults.

    Attributes:
        rate: of failure inside a fault; below 1 the policy is flaky.
        background: rate of failure where no fault is, by chance.
        signal: what times of success tell: ``smooth``, how near a fault is; ``flat``, nothing; ``noise``.
    """

    task: str
    faults: tuple[Fault, ...]
    rate: float
    signal: Signal
    seed: int
    background: float = 0.0

    def fails(self, scene: Scene) -> float:
        """The true failure rate in a scene."""
        return 1 - (1 - self.background) * (1 - self.rate * bool(self.met(scene)))

    def met(self, scene: Scene) -> list[int]:
        """The faults whose conditions a scene meets."""
        table = {path: np.array([value]) for path, value in values_of(scene).items()}
        return [index for index, fault in enumerate(self.faults) if fault.holds(table)[0]]

    def evaluate(self, scene: Scene, number: int = 0) -> Outcome:
        """One rollout; without a rollout where the scene is not fair."""
        space, stages = space_of(self.task), TASKS[self.task].stage_names
        if rejection := check_static(scene, space.catalogue, space.operators.min_distance):
            return Outcome.invalid(rejection.check, rejection.reason)
        rng = np.random.default_rng([self.seed, int(scene.digest[:16], 16), number])
        met = self.met(scene)
        noise = float(rng.random())
        lost = [self.faults[index].stage for index in met] if met and rng.random() < self.rate else []
        if rng.random() < self.background:
            shares = np.random.default_rng([self.seed, 5]).dirichlet(np.ones(len(stages)))  # of failures by chance
            lost.append(int(np.searchsorted(np.cumsum(shares[:-1]), rng.random())))
        if lost:
            reached = stages[: min(lost)]
            return Outcome.of((_rollout(scene, (len(reached) + 0.5 * noise) / len(stages), reached, LATEST),), stages)
        late = {"smooth": self._nearness(scene), "flat": 0.5, "noise": noise}[self.signal]
        steps = SOONEST + round(late * (LATEST - SOONEST))
        return Outcome.of((_rollout(scene, 1.0, stages, steps),), stages)

    def _nearness(self, scene: Scene) -> float:
        values, spans = values_of(scene), _spans(self.task)
        margins = [
            sum(condition.margin(values, spans) for condition in fault.conditions) / len(fault.conditions)
            for fault in self.faults
        ]
        return float(1 - min(1.0, 2 * min(margins, default=1.0)))


def _rollout(scene: Scene, progress: float, reached: Sequence[str], steps: int) -> Rollout:
    success = progress >= 1.0
    return Rollout(
        success_once=success,
        success_at_end=success,
        reached=tuple(reached),
        progress=progress,
        trace=np.append(np.linspace(0, min(progress, 0.99), steps - 1), progress).astype(np.float32),
        actions=np.zeros((0, 7), dtype=np.float32),
        states_hash=scene.digest,
        seconds=0.0,
    )


class Kind(NamedTuple):
    """What can be a condition: ``tail`` of the range on one side, a range ``within`` it, or ``options``."""

    path: str
    form: Literal["tail", "upper", "options"]


KINDS = (
    *(Kind(f"targets.0.{axis}", "tail") for axis in ("x", "y", "yaw")),
    *(Kind(f"camera.{axis}", "tail") for axis in ("roll", "pitch", "yaw")),
    Kind("camera.distance", "upper"),
    Kind("light", "tail"),
    Kind("confounders", "upper"),
    Kind("nearest", "upper"),
    Kind("targets.0.object", "options"),
    Kind("targets.0.rest", "options"),
    Kind("instruction", "options"),
)
_GROUPS: Mapping[str, frozenset[str]] = {
    "targets.0.x": frozenset({"target-position"}),
    "targets.0.y": frozenset({"target-position"}),
    "targets.0.yaw": frozenset({"target-orientation"}),
    "targets.0.rest": frozenset({"target-orientation"}),
    "targets.0.object": frozenset({"target-type"}),
    "camera.roll": frozenset({"camera-orientation"}),
    "camera.pitch": frozenset({"camera-orientation"}),
    "camera.yaw": frozenset({"camera-orientation"}),
    "camera.distance": frozenset({"camera-position"}),
    "light": frozenset({"light"}),
    "confounders": frozenset({"confounders"}),
    "nearest": frozenset({"confounders"}),
    "instruction": frozenset({"wording"}),
}


@cache
def space_of(task: str) -> SearchSpace:
    """The default space with the wording, without the check of visibility, which takes most of the time."""
    operators = load_operators()
    operators = replace(operators, varied=operators.varied | {"wording"}, visible=None)
    return SearchSpace(operators, load_catalogue(), task)


def values_of(scene: Scene) -> dict[str, float]:
    """What conditions are about: genes, log2 of the light, minus the distance of the nearest confounder."""
    values = space_of(scene.task).values(scene)
    target = scene.targets[0]
    away = [math.hypot(other.x - target.x, other.y - target.y) for other in scene.confounders]
    return {kind.path: values[kind.path] for kind in KINDS if kind.path in values} | {
        "light": math.log2(scene.light.intensity),
        "nearest": -min(away) if away else math.nan,
    }


@cache
def table_of(task: str) -> Table:
    """The values of random scenes."""
    rng = np.random.default_rng(20_000)
    scenes = [values_of(space_of(task).sample(rng)) for _ in range(SAMPLES)]
    return {kind.path: np.array([scene[kind.path] for scene in scenes]) for kind in KINDS}


@cache
def _nominal() -> Table:
    return {path: np.array([value]) for path, value in values_of(space_of("pick-up").nominal()).items()}


@cache
def _spans(task: str) -> Mapping[str, float]:
    return {path: float(np.nanmax(values) - np.nanmin(values)) for path, values in table_of(task).items()}


def worlds(density: Density, seeds: Sequence[int], *, rate: float | None = None) -> list[World]:
    """Worlds of one density, half of them flaky unless a rate is given."""
    return [world(density, seed, rate) for seed in seeds]


def world(density: Density, seed: int, rate: float | None = None) -> World:
    """A random world: 8 to 16 faults; their prevalence is log-uniform and scaled until the share fails."""
    rng = np.random.default_rng([seed, list(DENSITIES).index(density), 17])
    task = "pick-up"
    table, goal = table_of(task), DENSITIES[density]
    shares = np.sort(10 ** rng.uniform(-3, -1, rng.integers(8, 17)))[::-1]
    scale = 1.0
    faults: list[Fault] = []
    for _ in range(12):
        shown = np.random.default_rng([seed, 3])
        faults = []
        for share in shares:
            faults.append(_fault(float(np.clip(share * scale, RAREST, 0.3)), table, shown, faults))
        failing = float(np.mean(np.logical_or.reduce([fault.holds(table) for fault in faults])))
        if abs(failing - goal) < 0.1 * goal:
            break
        scale *= (goal / max(failing, 1e-4)) ** 0.8
    flaky = (0.7 if seed % 2 else 1.0) if rate is None else rate
    signal: Signal = ("smooth", "flat", "noise")[seed % 3]
    return World(task, tuple(faults), flaky, signal, seed)


def _fault(share: float, table: Table, rng: Rng, others: Sequence[Fault]) -> Fault:
    """A random fault of about this prevalence that spares the nominal scene and is no part of another one."""
    nominal = _nominal()
    best: tuple[float, Fault] | None = None
    for _ in range(TRIES):
        number = int(rng.integers(1, 4))
        kinds = [KINDS[index] for index in rng.choice(len(KINDS), number, replace=False)]
        conditions = tuple(_condition(kind, share ** (1 / number), table, number, rng) for kind in kinds)
        fault = Fault(conditions, int(rng.integers(3)))
        found = float(np.mean(fault.holds(table)))
        if fault.holds(nominal)[0] or found == 0 or any(_nested(fault, other, table) for other in others):
            continue
        off = abs(math.log(found / share))
        if best is None or off < best[0]:
            best = off, fault
        if off < 0.3:
            break
    assert best is not None
    return best[1]


def _nested(one: Fault, other: Fault, table: Table) -> bool:
    """Whether one of the faults holds in most scenes of the other one."""
    first, second = one.holds(table), other.holds(table)
    return bool((first & second).sum() > MOST_SHARED * min(first.sum(), second.sum()))


def _condition(kind: Kind, share: float, table: Table, number: int, rng: Rng) -> Condition:
    """A condition that about this share of random scenes meets."""
    values = table[kind.path][~np.isnan(table[kind.path])]
    if kind.form == "options":
        options, counts = np.unique(values, return_counts=True)
        order = rng.permutation(len(options))
        many = int(np.searchsorted(np.cumsum(counts[order]) / len(table[kind.path]), share)) + 1
        many = min(many, max(len(options) - 1, 1))
        return Condition(kind.path, options=frozenset(int(options[index]) for index in order[:many]))
    if kind.form == "tail" and number > 1 and rng.random() < 0.3:  # somewhere within the range
        start = rng.uniform(0, 1 - share)
        low, high = np.quantile(values, [start, start + share])
        return Condition(kind.path, float(low), float(high))
    share = min(share * len(table[kind.path]) / len(values), 0.9)
    if kind.form == "upper" or rng.random() < 0.5:
        return Condition(kind.path, low=float(np.quantile(values, 1 - share)))
    return Condition(kind.path, high=float(np.quantile(values, share)))
