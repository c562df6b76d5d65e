"""Swapped and additional things in LIBERO's scenes: where they stand, and what is fair."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from tests.worlds.libero.spaces import libero_space
from vlafuzz.errors import SceneError, UsageError
from vlafuzz.failures.described import deviations
from vlafuzz.failures.triage.directions import directed
from vlafuzz.model.conditions import Conditions
from vlafuzz.model.evidence import Causes
from vlafuzz.model.outcome import Verdict
from vlafuzz.model.scene import Placement, Scene, Start
from vlafuzz.rollouts.setup import make_evaluator
from vlafuzz.worlds.libero.casts import pool
from vlafuzz.worlds.libero.env import LiberoEnv
from vlafuzz.worlds.libero.evaluator import LiberoEvaluator, Workplace
from vlafuzz.worlds.libero.expert import LiberoExpert
from vlafuzz.worlds.libero.room import room_of
from vlafuzz.worlds.libero.setting import Setting
from vlafuzz.worlds.libero.space import LiberoSpace
from vlafuzz.worlds.libero.suites import REST, SETTLING
from vlafuzz.worlds.manipulation.operator_set import load_operators
from vlafuzz.worlds.manipulation.operators import OPERATORS, ConfounderType

pytestmark = pytest.mark.libero
SOUP = "libero_object/0"  # the basket's
BOWLS = "libero_goal/8"  # of the fixture ``bowls``, with furniture


@pytest.fixture(scope="module")
def space() -> LiberoSpace:
    everything = load_operators("libero").only(OPERATORS.keys() - {"backdrop"})
    return libero_space(everything, SOUP)


@pytest.fixture(scope="module")
def expert() -> Iterator[LiberoEvaluator]:
    made = make_evaluator(Conditions(task=SOUP, robot="libero", stop_early=True), LiberoExpert())
    assert isinstance(made, LiberoEvaluator)
    yield made
    made.close()


@pytest.fixture(scope="module")
def workplace() -> Iterator[Workplace]:
    made = Workplace(BOWLS, 64, "full")
    yield made
    made.close()


def swapped(scene: Scene, name: str, *added: Placement) -> Scene:
    """The scene with another first target, what is added, and the words for it."""
    first, *others = scene.targets
    said = scene.instruction.replace("alphabet soup", name.replace("_", " "))
    targets = (replace(first, object=name), *others)
    return replace(scene, targets=targets, instruction=said, confounders=added)


def added(name: str, x: float, y: float, yaw: float = 0.0) -> Placement:
    return Placement(name, REST, x, y, yaw)


def begun(workplace: Workplace, scene: Scene) -> LiberoEnv:
    setting = workplace.of(scene)
    setting.begin(scene)
    return setting.env


class TestSpace:
    def test_random_scenes_swap_and_add_and_come_back_from_their_genomes(self, space: LiberoSpace):
        rng = np.random.default_rng(0)
        scenes = [space.sample(rng) for _ in range(40)]
        assert [space.decode(space.encode(scene)) for scene in scenes] == scenes
        assert {len(scene.confounders) for scene in scenes} == {0, 1, 2, 3}
        assert len({scene.targets[0].object for scene in scenes}) > 5
        names = [[placed.object for placed in scene.placements] for scene in scenes]
        assert all(len(set(some)) == len(some) for some in names)
        assert [room_of(SOUP).crowded(scene) for scene in scenes] == [set()] * 40

    def test_the_instruction_says_the_swapped_thing(self, space: LiberoSpace):
        index = space.composer.layout.slots["targets.0"].index("ketchup")
        scene = space.composer.compose(space.nominal_values | {"targets.0.object": index})
        assert scene.instruction == "pick up the ketchup and place it in the basket"
        assert space.severities(scene)["target-type"] == 1.0
        assert space.nominal(like=scene) == scene

    def test_operators_are_reset_one_by_one(self, space: LiberoSpace):
        scene = swapped(space.nominal(), "ketchup", added("wine_bottle", -0.2, -0.35, 90.0))
        assert space.reset(scene, ["target-type"]) == replace(space.nominal(), confounders=scene.confounders)
        assert space.reset(scene, ["confounder-count"]) == swapped(space.nominal(), "ketchup")
        assert space.reset(scene, ["confounder-orientation"]).confounders[0].yaw == 0.0
        assert space.reset(scene, ["target-type", "confounder-count"]) == space.nominal()

    def test_what_deviates_is_said_by_operator_and_thing(self, space: LiberoSpace):
        scene = swapped(space.nominal(), "ketchup", added("wine_bottle", -0.2, -0.35))
        milk = scene.targets.index(added("milk_1", 0.0, 0.0))
        targets = (*scene.targets[:milk], added("milk_1", 0.04, 0.0), *scene.targets[milk + 1 :])
        moved = replace(scene, targets=targets)
        shown = {part.operator: part.value for part in deviations(space, moved, Causes())}
        assert shown == {
            "bystander-position": "milk 1: x 0.04 m, y 0 m",
            "confounders": "wine bottle at x -0.2 m, y -0.35 m",
        }
        assert directed(space, moved, shown) == ["confounders:1,bottle", "bystander-position:+x5"]

    def test_a_task_may_lack_what_varies_by_default_but_not_what_is_asked_for_alone(self):
        pots, usual = "libero_10/8", load_operators("libero")  # both are carried, and said in one word
        varied = {gene.operator for gene in libero_space(usual, pots).genes}
        assert {"target-type", "bystander-position"} == usual.varied - varied
        with pytest.raises(UsageError, match="target-type: nothing of libero_10/8 varies so"):
            libero_space(usual.only(["target-type"]), pots)

    def test_operators_choose_from_the_things_that_may_be_added(self):
        operators = load_operators("libero")
        names = operators.get(ConfounderType).model_copy(update={"names": ("milk",)})
        chosen = replace(operators, operators={**operators.operators, ConfounderType.name: names})
        space = libero_space(chosen, BOWLS)
        assert space.composer.layout.of("confounders") == ["confounders.0"]
        apple = names.model_copy(update={"names": ("apple",)})
        unknown = replace(operators, operators={**operators.operators, ConfounderType.name: apple})
        with pytest.raises(UsageError, match="confounder-type: names: no 'apple' in LIBERO"):
            libero_space(unknown, BOWLS)

    def test_two_confounders_in_one_place_are_moved_apart(self, space: LiberoSpace):
        here = added("popcorn", -0.2, -0.35), added("wine_bottle", -0.2, -0.35)
        scene = replace(space.nominal(), confounders=here)
        assert room_of(SOUP).crowded(scene) == {8}
        apart = space.repaired(scene, np.random.default_rng(0))
        assert apart is not None
        assert apart.confounders[0] == here[0]
        assert apart.confounders[1].object == "wine_bottle"
        assert room_of(SOUP).crowded(apart) == set()


class TestSetting:
    def test_the_suites_things_begin_where_they_do_without_additional_ones(
        self, bowls: LiberoEnv, workplace: Workplace
    ):
        nominal = libero_space(load_operators("libero"), BOWLS).nominal()
        scene = replace(nominal, start=Start(3), confounders=(added("milk", 0.1, 0.3),))
        env = begun(workplace, scene)
        bowls.reset(3)
        assert env.more == pool(env.task)
        for name in (*bowls.task.things, *bowls.robosuite.fixtures_dict):
            own, other = bowls.bodies[name], env.bodies[name]
            assert np.allclose(bowls.data.xpos[own], env.data.xpos[other], atol=1e-12)
            assert np.allclose(bowls.data.xquat[own], env.data.xquat[other], atol=1e-12)
        assert set(env.bodies) == {*bowls.bodies, "milk"}

    def test_additional_things_stand_still_where_the_scene_says_and_others_stay_away(self, workplace: Workplace):
        nominal = libero_space(load_operators("libero"), BOWLS).nominal()
        env = begun(workplace, replace(nominal, confounders=(added("milk", 0.1, 0.3, 30.0),)))
        env.settle(2 * SETTLING)
        assert env.data.xpos[env.bodies["milk"]][:2] == pytest.approx([0.1, 0.3], abs=0.005)
        away = env.data.xpos[env.robosuite.obj_body_id["popcorn"]]
        assert away[2] == pytest.approx(-5.0, abs=1e-3)
        shown = begun(workplace, replace(nominal, confounders=(added("milk", 0.1, 0.3),)))
        assert "popcorn" not in shown.movable

    def test_a_swapped_thing_stands_where_the_original_did_and_solves_the_task(self, workplace: Workplace):
        nominal = libero_space(load_operators("libero"), BOWLS).nominal()
        scene = replace(nominal, targets=(replace(nominal.targets[0], object="yellow_bowl"), *nominal.targets[1:]))
        env = begun(workplace, scene)
        place, original = env.data.xpos[env.bodies["yellow_bowl"]].copy(), env.states[0]
        at = env.away.addresses["akita_black_bowl_1"]
        assert place[:2] == pytest.approx(original[1 + at : 3 + at], abs=1e-9)
        assert "akita_black_bowl_1" not in env.bodies
        assert not env.solved()
        state = env.state()
        plate = env.data.xpos[env.bodies["plate_1"]]
        start = 1 + env.away.addresses["yellow_bowl"]
        state[start : start + 3] = plate + np.array([0.0, 0.0, 0.03])
        env.restore(state)
        env.settle(SETTLING)
        assert env.solved()

    def test_what_is_added_beside_the_table_falls(self, workplace: Workplace):
        nominal = libero_space(load_operators("libero"), BOWLS).nominal()
        beside = replace(nominal, confounders=(added("milk", 0.0, 2.0),))
        rejection = workplace.fairness.check(beside)
        assert rejection is not None
        assert rejection.check == "settling"
        assert rejection.reason.startswith("milk falls")

    def test_an_environment_without_what_a_scene_has_says_so(self, bowls: LiberoEnv):
        nominal = libero_space(load_operators("libero"), BOWLS).nominal()
        with pytest.raises(SceneError, match="milk: not in this environment of libero_goal/8"):
            Setting(bowls).begin(replace(nominal, confounders=(added("milk", 0.1, 0.3),)))


class TestEvaluator:
    def test_the_expert_solves_scenes_with_swapped_and_additional_things(self, expert, space):
        scene = swapped(space.nominal(), "ketchup", added("wine_bottle", -0.2, -0.35))
        outcome = expert.evaluate([scene])[0]
        assert outcome.verdict is Verdict.PASSED
        assert outcome.rollouts[0].reached == ("reach", "grasp", "move", "goal")

    def test_no_scene_depends_on_those_before_it(self, expert, space):
        nominal = space.nominal()
        others = [swapped(nominal, "orange_juice"), swapped(nominal, "ketchup", added("popcorn", -0.2, -0.35))]
        first = expert.evaluate([nominal, *others])
        again = expert.evaluate([*reversed(others), nominal])
        hashes = [[outcome.rollouts[0].states_hash for outcome in some] for some in (first, again)]
        assert hashes[0] == hashes[1][::-1]

    @pytest.mark.parametrize(
        ("name", "given", "check", "problem"),
        [
            ("spaceship", (), "semantic", "are not the things of libero_object/0"),
            ("ketchup", (added("spaceship", 0.0, 0.0),), "semantic", "'spaceship' cannot be added"),
            ("ketchup", (added("ketchup", 0.0, 0.0),), "semantic", "ketchup is there twice"),
            ("ketchup", (replace(added("popcorn", 0.0, 0.0), scale=2.0),), "semantic", "have one size"),
            ("ketchup", (added("wine_bottle", 0.11, -0.2),), "geometry", "milk_1 and wine_bottle overlap"),
        ],
    )
    def test_what_is_not_fair_is_said_in_a_sentence(self, expert, space, name, given, check, problem):
        rejection = expert.check(swapped(space.nominal(), name, *given))
        assert (rejection.check, problem in rejection.reason) == (check, True)

    def test_a_target_behind_an_additional_thing_is_not_fair(self, expert, space):
        box = added("macaroni_and_cheese", -0.03, -0.215, 90.0)
        rejection = expert.check(replace(space.nominal(), confounders=(box,)))
        assert rejection.check == "unseen"
        assert "of alphabet_soup_1, usually" in rejection.reason
