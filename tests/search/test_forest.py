from collections.abc import Callable

import numpy as np
import pytest

from vlafuzz.model.outcome import Verdict
from vlafuzz.search import forest
from vlafuzz.search.forest import Forest
from vlafuzz.search.scoring import Score

World = Callable[[np.ndarray], list[Score]]
FAILED = Score(Verdict.FAILED, 0.3, 1.0, cell="grasp|base|x0y0")


def passed(slack: float = 0.5) -> Score:
    return Score(Verdict.PASSED, 1.0, 1.0, slack=slack)


def drawn(n: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).random((n, 4))


def right_half(points: np.ndarray) -> list[Score]:
    return [FAILED if point[0] > 0.5 else passed() for point in points]


def late_on_the_left(points: np.ndarray) -> list[Score]:
    return [passed(slack=float(point[0])) for point in points]


def taught(*worlds: World) -> Forest:
    """A forest that learnt 32 scenes of each world."""
    made = Forest(0)
    for number, world in enumerate(worlds):
        points = drawn(32, number)
        made.learn(points, world(points))
    return made


def test_it_predicts_what_it_was_shown():
    points = drawn(100, 9)
    hardness = taught(*[right_half] * 4).votes(points).mean(axis=0)
    assert hardness[points[:, 0] > 0.6].min() > hardness[points[:, 0] < 0.4].max()


def left_half(points: np.ndarray) -> list[Score]:
    return right_half(1 - points)


def test_it_misleads_when_the_world_turns_round():
    made = taught(*[right_half] * 4)
    assert not made.misleads()
    for number in range(3):
        points = drawn(32, 10 + number)
        made.learn(points, left_half(points))
    assert made.misleads()


def all_alike(points: np.ndarray) -> list[Score]:
    return [passed()] * len(points)


@pytest.mark.parametrize(("world", "foresees"), [(late_on_the_left, True), (all_alike, False)])
def test_it_knows_whether_it_foresees_lateness(world: World, foresees: bool):
    assert taught(*[world] * 4).foresees_lateness() is foresees


def test_what_it_remembers_is_bounded(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(forest, "REMEMBERED", 20)
    made = taught(*[right_half] * 6)
    assert [len(known) for known in made._known.values()] == [20, 20]
