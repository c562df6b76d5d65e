"""Guided strategies beat random where failures are planted: not always, but nearly."""

from functools import cache

import pytest

from tests.search.toy import Region, Signal, among, band, near
from tests.search.worlds import EASY, failures, space, toy
from vlafuzz.search.registry import STRATEGIES

REGIONS = {
    "two operators": EASY,
    "box": Region((near("targets.0.x", 0.0, 0.32), near("targets.0.y", 0.1, 0.5), near("camera.roll", 3.0, 10.0))),
    "slab": Region((band({"targets.0.x": 3.0, "targets.0.y": 2.0}, 0.9),)),
    "objects": Region((among("targets.0.object", ("apple", "orange", "sponge")), near("confounders", 3.0, 3.0))),
}

guided = pytest.mark.parametrize("name", ["nsga2", "feedback", "surrogate"])


@cache
def found(name: str, seed: int, region: str = "two operators", signal: Signal = "smooth") -> int:
    """Failures in 96 rollouts, where one generated scene of twenty fails."""
    return len(failures(STRATEGIES[name](space(), seed, 96), toy(REGIONS[region], 0.05, signal), 96))


@guided
@pytest.mark.parametrize("region", REGIONS)
def test_guided_finds_twice_what_random_finds_in_two_of_three_runs(name: str, region: str):
    pairs = [(found(name, seed, region), found("random", seed, region)) for seed in range(3)]
    assert sum(one >= 2 * other for one, other in pairs) >= 2, pairs


@guided
@pytest.mark.parametrize("signal", ["flat", "noise"])
def test_guided_is_no_worse_than_random_where_passes_say_nothing(name: str, signal: Signal):
    pairs = [(found(name, seed, signal=signal), found("random", seed)) for seed in range(3)]
    assert sum(one >= other for one, other in pairs) >= 2, pairs
