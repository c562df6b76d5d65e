"""The scenes of LIBERO's tasks, also with swapped and additional things, and what is said of them."""

import hashlib
from dataclasses import replace

import numpy as np
import pytest

from tests.worlds.libero.scenes import SOUP, TASK, added, moved, swapped
from vlafuzz.errors import UsageError
from vlafuzz.failures.described import deviations
from vlafuzz.failures.triage.path import directed
from vlafuzz.model import Causes, Scene
from vlafuzz.worlds.libero.room import room_of
from vlafuzz.worlds.libero.space import LiberoSpace
from vlafuzz.worlds.libero.world import WORLD
from vlafuzz.worlds.manipulation.operator_set import load_operators
from vlafuzz.worlds.manipulation.operators import ConfounderType

pytestmark = pytest.mark.libero


def test_what_a_task_is_about_has_a_map_of_where_it_is_moved(space: LiberoSpace):
    maps = WORLD.maps(TASK)
    titles = [f"Where {what} is moved, from above" for what in ("the target", "target 2")]
    assert [one.title for one in maps] == titles
    assert {path for one in maps for path in (one.across, one.along)} <= space.by_path.keys()


class TestSpace:
    def test_the_nominal_scene_is_the_suites_own_and_what_is_carried_comes_first(self, space):
        nominal = space.nominal()
        assert nominal.instruction == "put the bowl on the plate"
        assert all((one.x, one.y, one.yaw) == (0.0, 0.0, 0.0) for one in nominal.targets)
        names = [one.object for one in nominal.targets]
        assert (names[:2], len(names)) == (["akita_black_bowl_1", "plate_1"], space.task.targets)

    def test_two_things_in_one_place_are_moved_apart_and_the_others_stay(self, space):
        room, nominal = room_of(TASK), space.nominal()
        x, y = np.round(room.places[0][1] - room.places[0][0], 3).tolist()  # from the bowl to the plate
        onto = moved(nominal, "akita_black_bowl_1", x=x, y=y)
        assert room.crowded(onto) == {0, 1}
        apart = space.repaired(onto, np.random.default_rng(0))
        assert apart is not None
        assert room.crowded(apart) == set()
        assert apart.targets[2:] == onto.targets[2:]


class TestVariedSpace:
    def test_random_scenes_swap_and_add_and_come_back_from_their_genomes(self, varied):
        rng = np.random.default_rng(0)
        scenes = [varied.sample(rng) for _ in range(40)]
        assert [varied.decode(varied.encode(scene)) for scene in scenes] == scenes
        assert [Scene.from_json(scene.to_json()) for scene in scenes] == scenes
        assert len({scene.start.state for scene in scenes}) > 5
        assert {len(scene.confounders) for scene in scenes} == {0, 1, 2, 3}
        assert len({scene.targets[0].object for scene in scenes}) > 5
        names = [[placed.object for placed in scene.placements] for scene in scenes]
        assert all(len(set(some)) == len(some) for some in names)
        assert [room_of(SOUP).crowded(scene) for scene in scenes] == [set()] * 40

    def test_the_instruction_says_the_swapped_thing(self, varied):
        index = varied.composer.layout.slots["targets.0"].index("ketchup")
        scene = varied.composer.compose(varied.nominal_values | {"targets.0.object": index})
        assert scene.instruction == "pick up the ketchup and place it in the basket"
        assert varied.severities(scene)["target-type"] == 1.0
        assert varied.nominal(like=scene) == scene

    def test_the_last_wording_is_how_libero_pro_says_it_of_the_swapped_thing(self, varied):
        index = varied.composer.layout.slots["targets.0"].index("ketchup")
        scene = varied.composer.compose(varied.nominal_values | {"targets.0.object": index, "instruction": 6})
        assert scene.instruction == "grab ketchup and put it into basket"
        assert varied.decode(varied.encode(scene)) == scene

    def test_operators_are_reset_one_by_one(self, varied):
        scene = swapped(varied.nominal(), "ketchup", added("wine_bottle", -0.2, -0.35, 90.0))
        assert varied.reset(scene, ["target-type"]) == replace(varied.nominal(), confounders=scene.confounders)
        assert varied.reset(scene, ["confounder-count"]) == swapped(varied.nominal(), "ketchup")
        assert varied.reset(scene, ["confounder-orientation"]).confounders[0].yaw == 0.0
        assert varied.reset(scene, ["target-type", "confounder-count"]) == varied.nominal()

    def test_what_deviates_is_said_by_operator_and_thing(self, varied):
        scene = swapped(varied.nominal(), "ketchup", added("wine_bottle", -0.2, -0.35))
        milk = scene.targets.index(added("milk_1", 0.0, 0.0))
        targets = (*scene.targets[:milk], added("milk_1", 0.04, 0.0), *scene.targets[milk + 1 :])
        moved = replace(scene, targets=targets)
        shown = {part.operator: part.value for part in deviations(varied, moved, Causes())}
        milk, bottle = "milk 1: x 0.04 m, y 0 m", "wine bottle at x -0.2 m, y -0.35 m"
        assert shown == {"bystander-position": milk, "confounders": bottle}
        assert directed(varied, moved, shown) == ["confounders:1,bottle", "bystander-position:+x5"]

    def test_a_task_may_lack_what_varies_by_default_but_not_what_is_asked_for_alone(self):
        pots, usual = "libero_10/8", load_operators("libero")  # both are carried, and said in one word
        varied = {gene.operator for gene in LiberoSpace(usual, pots, "libero").genes}
        assert {"target-type", "bystander-position"} == usual.varied - varied
        with pytest.raises(UsageError, match="target-type: nothing of libero_10/8 varies so"):
            WORLD.space(pots, "libero", vary=["target-type"])

    def test_operators_choose_from_the_things_that_may_be_added(self):
        def only(name: str) -> LiberoSpace:
            operators = load_operators("libero")
            chosen = operators.get(ConfounderType).model_copy(update={"names": (name,)})
            own = replace(operators, operators=operators.operators | {chosen.name: chosen})
            return LiberoSpace(own, TASK, "libero")

        assert only("milk").composer.layout.of("confounders") == ["confounders.0"]
        with pytest.raises(UsageError, match="confounder-type: names: no 'apple' in LIBERO"):
            only("apple")

    def test_two_confounders_in_one_place_are_moved_apart(self, varied):
        here = added("popcorn", -0.2, -0.35), added("wine_bottle", -0.2, -0.35)
        scene = replace(varied.nominal(), confounders=here)
        assert room_of(SOUP).crowded(scene) == {8}
        apart = varied.repaired(scene, np.random.default_rng(0))
        assert apart is not None
        assert apart.confounders[0] == here[0]
        assert apart.confounders[1].object == "wine_bottle"
        assert room_of(SOUP).crowded(apart) == set()


def test_the_changes_of_libero_max_have_its_severities_and_happen_as_the_hand_comes_near():
    genes = LiberoSpace(load_operators("libero-max"), SOUP, "libero").genes
    levels = {gene.path: [gene.grid.value(level) for level in range(gene.grid.size)] for gene in genes}
    assert levels["target_slide.distance"] == levels["goal_slide.distance"] == [0.0, 0.06, 0.12]
    assert {5.0, -10.0, 15.0} < set(levels["camera_bump.yaw"])
    assert levels["light_switch.intensity"] == pytest.approx([0.3, 0.55, 1, 1 / 0.55, 1 / 0.3], rel=0.01)
    assert not any(path.endswith(".when") for path in levels)  # one moment leaves nothing to choose


def test_random_scenes_with_events_are_what_they_were_before_there_were_two_more():
    space, rng = WORLD.space(SOUP, "libero", vary=["events"]), np.random.default_rng(7)
    scenes = "".join(space.sample(rng).digest for _ in range(12))
    drawn = hashlib.blake2b(scenes.encode(), digest_size=8).hexdigest()
    assert (drawn, space.operators.digest) == ("eda4ac432597b413", "c716261225acb8e9c6487d058fb8e729")
    assert {"target-knock", "target-switch"}.isdisjoint(gene.operator for gene in space.genes)
