import numpy as np
import pytest

from vlafuzz.model import Gene, Grid

X = Grid(-0.2, 0.12, 0.001, -0.05)
YAW = Grid(-180, 180, 1, 0, wraps=True)
LIGHT = Grid(0.05, 20, 0.05, 1, log=True)
GRIDS = {"x": X, "yaw": YAW, "light": LIGHT, "third of five": Grid.choice(5, 2), "one": Grid(3, 3, 1, 3)}


@pytest.mark.parametrize("grid", GRIDS.values(), ids=GRIDS)
def test_levels_and_values_are_one_to_one(grid: Grid) -> None:
    values = [grid.value(level) for level in range(grid.size)]
    assert [grid.level(value) for value in values] == list(range(grid.size))
    assert all(grid.low <= value <= grid.high for value in values)
    assert grid.value(grid.nominal_level) == grid.nominal
    assert "-0.0" not in map(str, values)


def test_of_the_two_ends_of_a_circle_the_upper_one_is_kept() -> None:
    assert (YAW.level(180), YAW.level(-180)) == (359, None)


@pytest.mark.parametrize("value", [0.0005, 0.121, -0.201, float("nan"), float("inf")])
def test_what_is_between_levels_or_outside_has_none(value: float) -> None:
    assert X.level(value) is LIGHT.level(value - 0.2) is None


def test_distance_is_a_share_of_the_farthest_end() -> None:
    assert (X.distance(0.12), X.distance(-0.05)) == (1.0, 0.0)
    assert X.distance(-0.2) == pytest.approx(0.15 / 0.17)
    assert X.distance(5.0) == 1.0
    assert LIGHT.distance(20**0.5) == pytest.approx(0.5)
    assert YAW.distance(-90) == YAW.distance(270) == 0.5


def gene(spread: str, grid: Grid) -> Gene:
    return Gene("light", "light.intensity", "real", grid, spread=spread)  # type: ignore[arg-type]


def test_the_papers_light_is_a_fair_coin_and_then_linear() -> None:
    rng = np.random.default_rng(0)
    drawn = np.array([gene("coin", LIGHT).draw(rng) for _ in range(4000)])
    assert abs((drawn < 1).mean() - 0.5) < 0.03
    assert np.median(drawn[drawn > 1]) == pytest.approx(10.5, rel=0.05)
    assert np.median(drawn[drawn < 1]) == pytest.approx(0.525, rel=0.05)


def test_directions_are_even_on_the_sphere() -> None:
    rng = np.random.default_rng(0)
    drawn = np.array([gene("sphere", Grid(-90, 90, 1, 0)).draw(rng) for _ in range(4000)])
    assert abs((np.abs(drawn) < 30).mean() - 0.5) < 0.03
