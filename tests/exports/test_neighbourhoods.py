import numpy as np
import pytest

from tests.doubles import scene
from vlafuzz.exports.selection import RADIUS, neighbourhoods
from vlafuzz.model.scene import Scene
from vlafuzz.worlds.tabletop.objects import load_catalogue
from vlafuzz.worlds.tabletop.space import SearchSpace, load_operators


def place(scene: Scene) -> np.ndarray:
    return np.array([scene.targets[0].x, scene.targets[0].y])


def at(*places: tuple[float, float]) -> list[Scene]:
    return [scene(x=x, y=y) for x, y in places]


def clusters(scenes: list[Scene], embed=place) -> int:
    return len(set(neighbourhoods(scenes, embed).values()))


def test_near_duplicates_count_as_one():
    near = RADIUS / 4
    assert clusters(at((0, 0), (near, 0), (0, near), (1, 0), (1, near), (0, 1))) == 3


@pytest.mark.parametrize(("places", "count"), [([], 0), ([(0, 0)], 1), ([(0, 0), (0, 0)], 1)])
def test_of_no_scene_or_one_there_is_nothing_to_group(places, count: int):
    assert clusters(at(*places)) == count


def test_a_chain_of_small_steps_is_not_one_group():
    chain = at(*((0.05 * step, 0.0) for step in range(100)))
    assert 10 <= clusters(chain) <= 25


def test_the_order_in_which_scenes_were_found_does_not_matter():
    rng = np.random.default_rng(0)
    scenes = at(*rng.random((200, 2)).round(3).tolist())
    assert len({clusters([scenes[i] for i in rng.permutation(200)]) for _ in range(5)}) == 1


def test_random_scenes_are_all_different_and_nudged_ones_all_alike():
    space = SearchSpace(load_operators(), load_catalogue(), "pick-up")
    scenes = [space.sample(np.random.default_rng([0, number])) for number in range(40)]
    light = space.by_path["light.intensity"].grid
    nudged = [
        Scene(**{**vars(each), "light": type(each.light)(light.value(light.size // 2))}) for each in scenes[:1] * 5
    ]
    assert clusters(scenes, space.embed) == 40
    assert clusters(nudged, space.embed) == 1
