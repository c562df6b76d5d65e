"""Thresholds of simulated policies: only their failure rates are known, by the scene."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from statistics import median

import numpy as np
import pytest

from tests.failures.triage.planted import EDGES, SPACE
from vlafuzz.failures.triage.oracle import Jitter
from vlafuzz.failures.triage.path import Path, free_genes
from vlafuzz.failures.triage.thresholds import Located, locate
from vlafuzz.model.evidence import Rate
from vlafuzz.model.scene import Camera, Scene
from vlafuzz.worlds.manipulation.jitter import jittered

NOMINAL = SPACE.nominal()
YAW = "camera.yaw"
STEP = 0.1  # degrees of yaw


@dataclass
class Simulated:
    """Fails with a rate that depends on the scene, in its neighbourhood if there is a jitter."""

    rate: Callable[[Scene], float | None]
    seed: int = 0
    jitter: Jitter | None = None
    room: int = 1000
    spent: int = 0
    asked: list[Scene] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._rng = np.random.default_rng(self.seed)

    def sample(self, scenes: Sequence[Scene]) -> list[bool | None]:
        return [self._roll(scene) for scene in scenes]

    def _roll(self, scene: Scene) -> bool | None:
        shown = self.jitter(scene, self.spent) if self.jitter else scene
        rate = self.rate(shown)
        if rate is None or self.room == 0:
            return None
        self.asked.append(scene)
        self.room, self.spent = self.room - 1, self.spent + 1
        return bool(self._rng.random() < rate)


def path_to(scene: Scene, operator: str = "camera-orientation") -> Path:
    return Path(SPACE, scene, free_genes(SPACE, scene, [operator]))


def yaw(degrees: float) -> Path:
    return path_to(replace(NOMINAL, camera=Camera(yaw=degrees)))


def beyond(*bounds: float) -> Callable[[Scene], float]:
    """Fails beyond the first yaw, passes beyond the second, and so on."""
    return lambda scene: float(sum(scene.camera.yaw > bound for bound in bounds) % 2)


def rises(at: float, width: float, low: float = 0.0, high: float = 1.0) -> Callable[[Scene], float]:
    """A rate that is one half at a yaw."""
    half = (0.5 - low) / (high - low)
    middle = at - width * math.log(half / (1 - half))
    return lambda scene: low + (high - low) / (1 + math.exp(-(scene.camera.yaw - middle) / width))


def lapsing(rate: Callable[[Scene], float], share: float) -> Callable[[Scene], float]:
    return lambda scene: share + (1 - 2 * share) * rate(scene)


PASSES, FAILS = Rate.of_counts(0, 5), Rate.of_counts(5, 5)


def found(path: Path, policy: Simulated) -> Located:
    located = locate(path, policy, PASSES, FAILS)
    assert located is not None
    return located


def planted(number: int) -> list[tuple[int, float]]:
    return [(seed, np.random.default_rng([7, seed]).uniform(0.3, 2.6)) for seed in range(number)]


def test_a_threshold_is_the_first_value_that_fails_and_every_rollout_counts():
    policy = Simulated(beyond(2.14))
    located = found(yaw(2.7), policy)
    assert (located.crossing, located.ranges) == (22, ((22, None),))
    assert located.low <= 21.4 <= located.high <= located.low + 3
    assert policy.spent == len(policy.asked) <= 25


@pytest.mark.parametrize("edge", EDGES, ids=lambda edge: edge[1])
def test_sharp_thresholds_in_the_neighbourhood_are_within_a_grid_step(edge):
    operator, where, first, step, holds = edge
    rng = np.random.default_rng(5)
    gene = SPACE.by_path[where]
    away = 1 if first > gene.grid.nominal else -1
    errors, spent = [], []
    for seed in range(8):
        level = gene.grid.snap(first) + away * int(rng.integers(2, 12))
        scene = SPACE.composer.compose(SPACE.nominal_values | {where: gene.grid.value(level)})
        policy = Simulated(lambda scene: float(holds(scene)), seed, jittered)
        path = path_to(scene, operator)
        errors.append(abs(SPACE.values(path.at(found(path, policy).crossing))[where] - first))
        spent.append(policy.spent)
    assert sum(error < 1.01 * step for error in errors) >= 7
    assert median(spent) <= 32


def test_a_policy_that_lapses_has_the_threshold_of_one_that_does_not():
    errors, spent = [], []
    for seed, at in planted(40):
        policy = Simulated(lapsing(beyond(at), 0.05), seed, jittered)
        errors.append(abs(found(yaw(2.7), policy).crossing * STEP - at))
        spent.append(policy.spent)
    assert sum(error < 1.5 * STEP for error in errors) >= 36
    assert median(spent) <= 32


@pytest.mark.parametrize(("width", "low", "high"), [(0.3, 0, 1), (0.6, 0, 1), (0.3, 0.1, 0.8)])
def test_intervals_of_smooth_rates_cover_where_they_cross_one_half(width, low, high):
    covered, spent = 0, []
    for seed, at in planted(40):
        policy = Simulated(rises(at, width, low, high), seed, jittered)
        located = found(yaw(4.0), policy)
        covered += located.low * STEP <= at <= located.high * STEP
        spent.append(policy.spent)
    assert covered >= 36
    assert max(spent) <= 60


@pytest.mark.parametrize("share", [0.0, 0.05])
def test_passes_beyond_a_threshold_are_found(share):
    right = 0
    for seed in range(12):
        policy = Simulated(lapsing(beyond(2.1, 3.4, 4.0), share), seed, jittered)
        located = found(yaw(4.3), policy)
        ends = [end for ends in located.ranges for end in ends]
        right += len(ends) == 4 and ends[3] is None and abs(ends[0] - 21) <= 2 and ends[1] <= 35 <= ends[2]
    assert right >= 10


def test_a_rate_that_stays_high_has_no_passes_beyond():
    single = [found(yaw(2.7), Simulated(lapsing(beyond(at), 0.1), seed)).ranges for seed, at in planted(40)]
    assert sum(len(ranges) == 1 and ranges[0][1] is None for ranges in single) >= 36


def test_what_is_not_fair_is_left_out():
    def rate(scene: Scene) -> float | None:
        return None if 1.0 < scene.camera.yaw < 1.6 else float(scene.camera.yaw > 1.3)

    located = found(yaw(2.0), Simulated(rate))
    assert located.low <= 10
    assert located.high >= 16


@pytest.mark.parametrize("room", [0, 5])
def test_there_is_no_threshold_without_rollouts(room):
    assert locate(yaw(2.7), Simulated(beyond(2.1), room=room), PASSES, FAILS) is None


def test_there_is_no_threshold_where_the_start_fails():
    always = Simulated(lambda scene: 0.9)
    assert locate(yaw(2.7), always, None, FAILS) is None
    assert always.spent <= 6
    assert locate(yaw(2.7), Simulated(lambda scene: None), None, FAILS) is None
    assert locate(yaw(2.7), Simulated(beyond(2.14)), None, FAILS) is not None
