"""Thresholds of simulated policies, of which only failure rates are known, and what they say of planted causes."""

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from statistics import median

import numpy as np
import pytest

from tests.failures.triage.planted import DARK, EDGES, SPACE, STAGES, Condition, Planted
from vlafuzz.failures.triage.attribute import Located, Seen, attribute, locate
from vlafuzz.failures.triage.certify import Shrunk
from vlafuzz.failures.triage.oracle import Jitter, Oracle
from vlafuzz.failures.triage.path import Path, directed, free_genes
from vlafuzz.model import Camera, Causes, Rate, Scene, Verdict
from vlafuzz.model.phrasing import describe
from vlafuzz.store.records import Judged
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
    """A rate that has risen by half at a yaw."""
    return lambda scene: low + (high - low) / (1 + math.exp(-(scene.camera.yaw - at) / width))


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
    assert (located.crossing, located.until) == (22, None)
    assert located.low <= 21.4 <= located.high <= located.low + 5
    assert policy.spent == len(policy.asked) <= 25


@pytest.mark.parametrize("edge", EDGES, ids=lambda edge: edge[1])
def test_sharp_thresholds_in_the_neighbourhood_are_within_two_grid_steps(edge):
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
    assert sum(error < 1.01 * step for error in errors) >= 5
    assert max(errors) < 2.01 * step
    assert median(spent) <= 32


def test_a_policy_that_lapses_has_the_threshold_of_one_that_does_not():
    errors, spent = [], []
    for seed, at in planted(40):
        policy = Simulated(lapsing(beyond(at), 0.05), seed, jittered)
        errors.append(abs(found(yaw(2.7), policy).crossing * STEP - at))
        spent.append(policy.spent)
    assert sum(error < 1.5 * STEP for error in errors) >= 34
    assert median(spent) <= 32


@pytest.mark.parametrize(("width", "low", "high"), [(0.3, 0, 1), (0.3, 0.5, 1), (0.3, 0.1, 0.8), (0.05, 0, 0.7)])
def test_intervals_cover_where_a_rate_has_risen_by_half(width, low, high):
    covered, spent, first = 0, [], Rate.of_counts(round(10 * low), 10)
    for seed, at in planted(40):
        policy = Simulated(rises(at, width, low, high), seed, jittered)
        steps = np.random.default_rng(seed + 1000).uniform(0, 40, 12)
        seen = [(step, policy.sample([replace(NOMINAL, camera=Camera(yaw=step * STEP))])[0]) for step in steps]
        usual = [number < first.failures for number in range(10 * (seed % 2))]
        located = locate(yaw(4.0), policy, first, FAILS, Seen(seen, usual=usual))
        covered += located.low * STEP <= at <= located.high * STEP
        spent.append(policy.spent)
    assert covered >= 36
    assert max(spent) <= 60


@pytest.mark.parametrize("share", [0.0, 0.05])
def test_passes_beyond_the_scene_are_found(share):
    right = 0
    for seed in range(12):
        located = found(yaw(2.7), Simulated(lapsing(beyond(2.1, 3.4), share), seed, jittered))
        right += located.until == 27 and abs(located.crossing - 21) <= 2
    assert right >= 10


def test_a_rate_that_stays_high_has_no_passes_beyond():
    single = [found(yaw(2.7), Simulated(lapsing(beyond(at), 0.1), seed)).until for seed, at in planted(40)]
    assert single.count(None) >= 36


def test_what_is_not_fair_is_left_out():
    unfair = Simulated(lambda scene: None if 1.0 < scene.camera.yaw < 1.6 else float(scene.camera.yaw > 1.3))
    located = found(yaw(2.0), unfair)
    assert located.low <= 10
    assert located.high >= 16


def test_there_is_no_threshold_without_rollouts_or_where_the_start_fails():
    assert all(locate(yaw(2.7), Simulated(beyond(2.1), room=room), PASSES, FAILS) is None for room in (0, 5))
    always = Simulated(lambda scene: 0.9)
    assert locate(yaw(2.7), always, None, FAILS) is None
    assert always.spent <= 6
    assert locate(yaw(2.7), Simulated(lambda scene: None), None, FAILS) is None
    assert locate(yaw(2.7), Simulated(beyond(2.14)), None, FAILS) is not None


def causes(*conditions: Condition, seed: int = 0) -> tuple[Causes, Planted]:
    judge = Planted(conditions)
    oracle = judge.oracle()
    return attribute(judge.shrunk(judge.finding(seed), oracle), oracle, SPACE), judge


@pytest.mark.parametrize("edge", EDGES, ids=lambda edge: edge[1])
def test_a_threshold_is_the_first_value_that_fails(edge):
    operator, path, first, step, condition = edge
    judge = Planted([condition])
    oracle = judge.oracle()
    shrunk = judge.shrunk(judge.finding(0), oracle)
    (threshold,) = attribute(shrunk, oracle, SPACE).thresholds
    assert threshold.operator == operator
    ((where, value),) = threshold.at
    assert (where, value) == (path, pytest.approx(first, abs=1.01 * step))
    ends = [dict(end)[path] for end in (threshold.low, threshold.high)]
    assert min(ends) <= first <= max(ends)
    assert threshold.ranges == ((threshold.at, ()),)
    assert threshold.direction == directed(SPACE, shrunk.scene, [operator])[0].partition(":")[2]


def test_a_threshold_says_where_the_policy_passes_beyond_it():
    found, _ = causes(lambda s: 2.1 < s.camera.yaw < 3.45, seed=3)
    (threshold,) = found.thresholds
    assert re.fullmatch(r"camera-orientation: fails from yaw 2\.[12]° \(.*\) to 2\.4°", describe(threshold))


def test_there_is_no_threshold_beside_what_is_not_fair():
    planted = Planted([DARK])
    scene = planted.finding(0)

    def judge(scenes, numbers):
        return [planted.judged(shown) if planted.fails(shown) else Judged(Verdict.INVALID) for shown in scenes]

    oracle = Oracle(judge, STAGES, None, budget=200, lead=1)
    shrunk = Shrunk(scene=scene, lost="grasp", operators=("light",), rate=Rate.of_counts(5, 5), firm=True)
    assert attribute(shrunk, oracle, SPACE).thresholds == ()


def test_several_values_of_an_operator_have_a_share_of_the_way():
    found, _ = causes(lambda s: s.camera.yaw + s.camera.roll > 3 and s.camera.yaw > 1 and s.camera.roll > 1)
    (threshold,) = found.thresholds
    assert [path for path, _ in threshold.at] == ["camera.roll", "camera.yaw"]
    at = dict(threshold.at)
    assert at["camera.roll"] + at["camera.yaw"] == pytest.approx(3.1, abs=0.21)
    assert 0 < threshold.share < 1


def test_of_two_that_are_necessary_neither_is_enough_and_both_have_thresholds():
    found, _ = causes(lambda s: s.camera.yaw > 2.5, lambda s: s.light.intensity < 0.4)
    assert found.necessary == ("light", "camera-orientation")
    assert found.sufficient == ()
    ((_, intensity),), ((_, yaw),) = (threshold.at for threshold in found.thresholds)
    assert (intensity, yaw) == (pytest.approx(0.4, abs=0.03), pytest.approx(2.6, abs=0.11))
