import pytest

from vlafuzz.model.scene import Placement, Scene
from vlafuzz.worlds.tabletop.fairness.footprint import crowding, share_closer, share_overlapping
from vlafuzz.worlds.tabletop.objects import load_catalogue

CATALOGUE = load_catalogue()


def scene(*things: Placement) -> Scene:
    return Scene("pick-up", things[:1], "pick up apple", confounders=things[1:])


def apple(x: float, y: float = 0.0, name: str = "apple") -> Placement:
    return Placement(name, "resting", x, y)


def test_the_nearest_two_of_three_count() -> None:
    result = crowding(scene(apple(0.0), apple(0.1), apple(0.0, 0.3)), CATALOGUE)
    assert result
    assert (result.nearest, result.overlap) == (pytest.approx(0.1), False)


def test_footprints_that_overlap() -> None:
    result = crowding(scene(apple(0.0), apple(0.06)), CATALOGUE)
    assert result
    assert result.overlap


def test_one_object_is_not_crowded() -> None:
    assert crowding(scene(apple(0.0)), CATALOGUE) is None


def test_a_plane_that_marks_a_place_takes_no_room() -> None:
    assert crowding(scene(apple(0.0), apple(0.01, name="custom:dummy_plane")), CATALOGUE) is None


def test_of_an_unknown_object_the_footprint_is_not_known() -> None:
    result = crowding(scene(apple(0.0), apple(0.01, name="ycb:apple")), CATALOGUE)
    assert result
    assert (result.nearest, result.overlap) == (pytest.approx(0.01), None)


def test_shares() -> None:
    results = [crowding(scene(apple(0.0), apple(x)), CATALOGUE) for x in (0.06, 0.1, 0.2)]
    crowded = [result for result in results if result]
    assert share_closer(crowded, 0.15) == pytest.approx(2 / 3, abs=1e-4)
    assert share_overlapping(crowded) == pytest.approx(1 / 3, abs=1e-4)
    assert share_closer([], 0.15) is share_overlapping([]) is None
