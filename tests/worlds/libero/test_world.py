"""LIBERO as a world: its scenes, also with swapped and additional things, what is fair of them, and rollouts."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from tests.doubles import Idle
from tests.worlds.libero.scenes import SOUP, TASK, added, moved, swapped
from vlafuzz.errors import UsageError
from vlafuzz.model import Backdrop, Camera, Conditions, InitialPose, Light, Placement, Scene, Verdict
from vlafuzz.model.scene import (
    ControlStall,
    GripSlip,
    GripWeak,
    InstructionChange,
    LightSwitch,
    Newcomer,
    Slide,
    Start,
    TargetTopple,
)
from vlafuzz.policies.base import ActionChunk, Observation, PolicySpec
from vlafuzz.policies.clients.model import Model
from vlafuzz.policies.clients.openpi import OpenPi
from vlafuzz.policies.clients.servers import parse
from vlafuzz.policies.controls import Frozen, Player
from vlafuzz.rollouts.setup import make_evaluator
from vlafuzz.worlds.evaluator import SceneEvaluator
from vlafuzz.worlds.events import begins
from vlafuzz.worlds.libero.casts import pool
from vlafuzz.worlds.libero.env import LiberoEnv
from vlafuzz.worlds.libero.evaluator import Workplace
from vlafuzz.worlds.libero.expert import LiberoExpert
from vlafuzz.worlds.libero.setting import Setting
from vlafuzz.worlds.libero.space import LiberoSpace
from vlafuzz.worlds.libero.suites import SETTLING, find_task
from vlafuzz.worlds.tabletop.experts.pinhole import Pinhole

pytestmark = pytest.mark.libero


@pytest.fixture
def setting(bowls: LiberoEnv, space: LiberoSpace) -> Iterator[Setting]:
    made = Setting(bowls)
    yield made
    made.begin(space.nominal())  # light and camera as they were


@pytest.fixture(scope="module")
def soup() -> Iterator[SceneEvaluator]:
    """LIBERO's expert in scenes in which a can of soup belongs in a basket."""
    evaluator = make_evaluator(Conditions(task=SOUP, robot="libero", stop_early=True), LiberoExpert())
    yield evaluator
    evaluator.close()


@pytest.fixture(scope="module")
def shown() -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Pictures and state that LIBERO itself gives of initial state 0 when a policy begins."""
    stock = LiberoEnv(find_task(TASK), size=256)
    stock.reset(0)
    stock.settle(SETTLING)
    pictures, state = stock.pictures(), stock.proprioception()
    stock.close()
    return pictures, state


def first_seen(space: LiberoSpace, spec: PolicySpec) -> Observation:
    """What a policy sees first of the same state in a rollout."""
    policy = Idle()
    policy.spec = spec
    evaluator = make_evaluator(Conditions(task=TASK, robot="libero"), policy)
    seen = evaluator.begin(space.nominal(), 0).observe()
    evaluator.close()
    return seen


@pytest.fixture(scope="module")
def workplace() -> Iterator[Workplace]:
    made = Workplace(TASK, 64, "full")
    yield made
    made.close()


def larger(name: str) -> Placement:
    return replace(added(name, 0.0, 0.0), scale=2.0)


BEFORE = added("macaroni_and_cheese", -0.03, -0.215, 90.0)  # the soup, as the camera sees it


def begun(workplace: Workplace, scene: Scene) -> LiberoEnv:
    setting = workplace.of(scene)
    setting.begin(scene)
    return setting.env


class TestSetting:
    def test_a_nominal_scene_begins_bit_for_bit_in_the_suites_state(self, bowls, space, setting):
        bowls.reset(3)
        bowls.settle(2)
        expected = bowls.state()
        setting.begin(replace(space.nominal(), start=Start(3)))
        bowls.settle(2)
        assert np.array_equal(bowls.state(), expected)

    def test_what_a_scene_changes_is_as_far_off_as_asked_and_nothing_else(self, bowls, space, setting):
        nominal = space.nominal()

        def now() -> list[np.ndarray]:
            places = [bowls.data.xpos[bowls.bodies[name]] for name in bowls.task.things[:2]]
            shown = bowls.data.camera("agentview").xpos, bowls.model.light_diffuse
            return [np.array(part) for part in (*places, np.degrees(bowls.data.qpos[:7]), *shown)]

        setting.begin(nominal)
        before = now()
        other = replace(nominal, camera=Camera(0.1, 90.0, 0.0), initial_pose=InitialPose(j2=2.0), light=Light(2.0))
        setting.begin(moved(other, "plate_1", x=0.03, y=-0.02))
        bowl, plate, joints, eye, lamps = (b - a for a, b in zip(before, now(), strict=True))
        assert bowl == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)
        assert plate == pytest.approx([0.03, -0.02, 0.0], abs=1e-9)
        assert joints == pytest.approx([0, 2, 0, 0, 0, 0, 0], abs=1e-9)
        assert eye == pytest.approx([0.0, 0.1, 0.0], abs=1e-9)
        assert lamps == pytest.approx(before[-1])
        setting.begin(nominal)
        assert all(map(np.array_equal, now(), before))

    @pytest.mark.parametrize(
        ("turn", "expected"), [("yaw", (np.sin(np.radians(5)), 0)), ("pitch", (0, np.sin(np.radians(5))))]
    )
    def test_a_turned_camera_shifts_the_picture(self, bowls, space, setting, turn, expected):
        """To the left everything goes to the right, and down everything goes up."""
        nominal = space.nominal()
        setting.begin(nominal)
        camera = bowls.data.camera("agentview")
        before = camera.xmat.reshape(3, 3).copy()
        setting.begin(replace(nominal, camera=Camera(**{turn: 5.0})))
        after = bowls.data.camera("agentview").xmat.reshape(3, 3)
        seen = after.T @ -before[:, 2]  # where the middle of the old picture is in the new one
        assert seen[:2] == pytest.approx(expected, abs=1e-6)

    def test_a_thing_is_seen_where_the_view_of_a_turned_camera_says(self, bowls, space, setting):
        turned = replace(space.nominal(), camera=Camera(yaw=4.0, pitch=-3.0))
        pictures, places = [], []
        for x in (0.0, 0.05):
            setting.begin(moved(turned, "plate_1", x=x))
            pictures.append(bowls.picture("agentview", 64)[:, ::-1].astype(float))
            places.append(setting.view.project(bowls.place("plate_1")[None])[0][0])
        down, right = np.nonzero(np.abs(pictures[0] - pictures[1]).max(axis=2) > 20)
        middle = [(right.min() + right.max() + 1) / 128, (down.min() + down.max() + 1) / 128]
        assert middle == pytest.approx(np.mean(places, axis=0), abs=0.04)


class Deaf(LiberoExpert):
    """Does not hear what it is told."""

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        return super().act([replace(seen, instruction="") for seen in observations])


class TestEvaluator:
    def test_the_expert_solves_the_nominal_scene_and_one_in_which_the_target_is_elsewhere(self, soup, varied):
        scenes = [varied.nominal(), moved(varied.nominal(), "alphabet_soup_1", x=-0.04, y=0.02)]
        outcomes = soup.evaluate(scenes)
        assert [outcome.verdict for outcome in outcomes] == [Verdict.PASSED, Verdict.PASSED]
        assert outcomes[0].rollouts[0].reached == ("reach", "grasp", "move", "goal")
        assert len({outcome.rollouts[0].states_hash for outcome in outcomes}) == 2

    def test_the_expert_solves_a_scene_in_which_the_soup_slides_away_and_the_light_goes_down(self, soup, varied):
        events = {"target_slide": Slide("approach", 0.06, 90.0), "light_switch": LightSwitch("grasp", 0.5)}
        scene = replace(varied.nominal(), **events)
        before, solved, again = soup.evaluate([varied.nominal(), scene, scene])
        assert solved.verdict is Verdict.PASSED
        assert solved.rollouts[0].states_hash == again.rollouts[0].states_hash != before.rollouts[0].states_hash
        far = replace(varied.nominal(), target_slide=Slide("start", 0.6, 90.0))
        assert soup.evaluate([far])[0].verdict is Verdict.INVALID

    def test_the_expert_sees_that_the_soup_slides_away_and_closes_its_hand_once_where_it_is_now(self, soup, varied):
        scene = replace(varied.nominal(), target_slide=Slide("approach", 0.12, 90.0))
        (solved,) = soup.evaluate([scene])
        gripper = solved.rollouts[0].actions[:, 6]
        assert solved.verdict is Verdict.PASSED
        assert np.count_nonzero(np.diff(gripper) < 0) == 1

    def test_the_expert_notices_that_the_soup_slipped_out_of_its_hand_and_goes_back_for_it(self, soup, varied):
        scene = replace(varied.nominal(), grip_slip=GripSlip("carry", 10))
        (solved,) = soup.evaluate([scene])
        closings = np.flatnonzero(np.diff(solved.rollouts[0].actions[:, 6]) < 0)
        assert (solved.verdict, len(closings)) == (Verdict.PASSED, 2)
        assert closings[1] - closings[0] < 80  # not after a way of 60 steps without it

    def test_the_expert_solves_a_scene_in_which_popcorn_is_put_down_meanwhile_bit_by_bit_the_same(self, soup, varied):
        crowded = replace(varied.nominal(), confounders=(added("popcorn", -0.2, -0.3),))
        scene = replace(crowded, newcomer=Newcomer("approach", "first"))
        solved, again, usual = soup.evaluate([scene, scene, crowded])
        assert (solved.verdict, usual.verdict) == (Verdict.PASSED, Verdict.PASSED)
        assert solved.rollouts[0].states_hash == again.rollouts[0].states_hash != usual.rollouts[0].states_hash

    @pytest.mark.parametrize("target", ["alphabet_soup_1", "ketchup"], ids=["fits", "must tip in"])
    def test_a_target_that_is_knocked_over_lies_still_at_once_and_only_who_looks_grasps_it(self, soup, varied, target):
        usual = varied.nominal() if target == "alphabet_soup_1" else swapped(varied.nominal(), target)
        scene = replace(usual, target_knock=TargetTopple("approach", "lying"))
        before, solved, again = soup.evaluate([usual, scene, scene])
        assert (before.verdict, solved.verdict) == (Verdict.PASSED, Verdict.PASSED)
        assert solved.rollouts[0].states_hash == again.rollouts[0].states_hash
        player = Player(LiberoExpert().spec)
        player.actions = before.rollouts[0].actions
        evaluator = make_evaluator(Conditions(task=SOUP, robot="libero"), player)
        (blind,) = evaluator.evaluate([scene])
        evaluator.close()
        assert blind.verdict is Verdict.FAILED
        workplace = Workplace(SOUP, 64, "full")
        setting = workplace.of(scene)
        setting.begin(scene)
        setting.env.settle(SETTLING)
        setting.happen(scene, scene.target_knock)
        body, places = setting.env.bodies[target], []
        for _ in range(3):
            setting.env.settle(5)
            places.append(setting.env.data.xpos[body].copy())
        workplace.close()
        assert np.ptp(places, axis=0).max() < 0.001  # metres, from a quarter of a second after it on

    def test_whoever_is_told_of_another_thing_lets_the_first_one_go_and_brings_that(self, soup, varied):
        scene = replace(varied.nominal(), target_switch=InstructionChange("grasp", "second"))
        usual, solved = soup.evaluate([varied.nominal(), scene])
        assert (solved.verdict, solved.rollouts[0].reached) == (Verdict.PASSED, ("reach", "grasp", "move", "goal"))
        told = soup.begin(scene, 0)
        player = Player(LiberoExpert().spec)
        player.actions = usual.rollouts[0].actions
        while not told.over:
            told.advance(player.act([told.observe()])[0].actions[0])
        assert told.observe().instruction == "pick up the cream cheese and place it in the basket"
        assert not told.rollout().success_once

    def test_a_lift_goes_on_after_a_stall(self, soup, varied):
        (solved,) = soup.evaluate([replace(varied.nominal(), control_stall=ControlStall("grasp", 10))])
        assert solved.verdict is Verdict.PASSED

    def test_a_grip_that_has_no_force_any_more_holds_nothing_and_has_it_back_in_the_next_scene(self, soup, varied):
        usual = varied.nominal()
        weak = replace(usual, grip_weak=GripWeak("approach", 0.01))
        before, failed, after = soup.evaluate([usual, weak, usual])
        assert (failed.verdict, failed.rollouts[0].success_once) == (Verdict.FAILED, False)
        assert before.rollouts[0].states_hash == after.rollouts[0].states_hash

    def test_whoever_is_told_to_stop_with_the_soup_in_the_hand_passes_by_standing_still_alone(self, soup, varied):
        scene = replace(varied.nominal(), instruction_change=InstructionChange("grasp", "stop"))
        (solved,) = soup.evaluate([scene])
        assert (solved.verdict, solved.rollouts[0].success_at_end) == (Verdict.PASSED, True)
        still = (solved.rollouts[0].actions[:, :6] == 0).all(axis=1)
        assert still[-80:].all()  # four seconds
        deaf = make_evaluator(Conditions(task=SOUP, robot="libero"), Deaf())
        (gone_on,) = deaf.evaluate([scene])
        deaf.close()
        assert (gone_on.verdict, gone_on.lost_stage) == (Verdict.FAILED, "goal")

    def test_what_happens_at_the_approach_happens_in_mid_episode_at_20_cm(self, soup, varied):
        scene = replace(varied.nominal(), light_switch=LightSwitch("approach", 0.5))
        (outcome,) = soup.evaluate([scene])
        trace, stages = outcome.rollouts[0].trace, outcome.rollouts[0].reached
        step = begins(scene.light_switch, trace, stages)
        assert step > 0
        assert trace[step - 1] * len(stages) == pytest.approx(1 - 0.2 / 0.4, abs=0.1)  # of reach, 0 at 40 cm

    def test_holding_still_solves_nothing_at_any_control_rate(self, varied):
        conditions = Conditions(task=SOUP, robot="libero")
        evaluator = make_evaluator(conditions, Frozen())  # decides five times a second
        outcome = evaluator.evaluate([varied.nominal()])[0]
        evaluator.close()
        assert outcome.verdict is Verdict.FAILED
        assert len(outcome.rollouts[0].actions) == 280 // 4

    def test_a_policy_that_needs_the_tabletop_is_refused(self):
        with pytest.raises(UsageError, match="works on the tabletop only"):
            make_evaluator(Conditions(task=SOUP, robot="libero"), Pinhole())

    def test_a_model_of_libero_gets_what_liberos_evaluations_send(self, space, shown):
        """Keys, sizes and numbers of openpi's example for LIBERO: 256 pixels made 224, fingers apart."""
        pictures, state = shown
        model = Model("openpi", parse("openpi:ws://localhost:1?profile=libero", OpenPi).options)
        message = model.message(first_seen(space, model.spec))
        assert message.keys() == {"observation/image", "observation/wrist_image", "observation/state", "prompt"}
        for key, camera in (("image", "agentview"), ("wrist_image", "robot0_eye_in_hand")):
            smaller = Image.fromarray(pictures[camera]).resize((224, 224), Image.Resampling.BILINEAR)
            assert np.array_equal(message[f"observation/{key}"], np.asarray(smaller))
        assert message["observation/state"] == pytest.approx(state, abs=1e-6)
        assert message["prompt"] == "put the bowl on the plate"


class TestVariedSetting:
    def test_the_suites_things_begin_where_they_do_without_additional_ones(self, bowls, space, workplace):
        nominal = space.nominal()
        scene = replace(nominal, start=Start(3), confounders=(added("milk", 0.1, 0.3),))
        env = begun(workplace, scene)
        bowls.reset(3)
        assert env.more == pool(env.task)
        for name in (*bowls.task.things, *bowls.robosuite.fixtures_dict):
            own, other = bowls.bodies[name], env.bodies[name]
            assert np.allclose(bowls.data.xpos[own], env.data.xpos[other], atol=1e-12)
            assert np.allclose(bowls.data.xquat[own], env.data.xquat[other], atol=1e-12)
        assert set(env.bodies) == {*bowls.bodies, "milk"}

    def test_additional_things_stand_still_where_the_scene_says_and_others_stay_away(self, space, workplace):
        nominal = space.nominal()
        env = begun(workplace, replace(nominal, confounders=(added("milk", 0.1, 0.3, 30.0),)))
        env.settle(2 * SETTLING)
        assert env.data.xpos[env.bodies["milk"]][:2] == pytest.approx([0.1, 0.3], abs=0.005)
        away = env.data.xpos[env.robosuite.obj_body_id["popcorn"]]
        assert away[2] == pytest.approx(-5.0, abs=1e-3)
        shown = begun(workplace, replace(nominal, confounders=(added("milk", 0.1, 0.3),)))
        assert "popcorn" not in shown.movable

    def test_a_swapped_thing_stands_where_the_original_did_and_solves_the_task(self, space, workplace):
        nominal = space.nominal()
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

    def test_what_is_added_beside_the_table_falls(self, space, workplace):
        nominal = space.nominal()
        beside = replace(nominal, confounders=(added("milk", 0.0, 2.0),))
        rejection = workplace.fairness.check(beside)
        assert rejection is not None
        assert rejection.check == "settling"
        assert rejection.reason.startswith("milk falls")


class TestVariedEvaluator:
    def test_scenes_with_swapped_and_additional_things_are_solved_whatever_came_before(self, soup, varied):
        nominal = varied.nominal()
        others = [swapped(nominal, "orange_juice"), swapped(nominal, "ketchup", added("wine_bottle", -0.2, -0.35))]
        first = soup.evaluate([nominal, *others])
        assert [outcome.verdict for outcome in first] == [Verdict.PASSED] * 3
        again = soup.evaluate([*reversed(others), nominal])
        hashes = [[outcome.rollouts[0].states_hash for outcome in some] for some in (first, again)]
        assert hashes[0] == hashes[1][::-1]

    @pytest.mark.parametrize(
        ("changed", "problem"),
        [
            (lambda one: replace(one, backdrop=Backdrop(wall="red")), "semantic: backdrop: scenes of libero_object/0"),
            (
                lambda one: replace(swapped(one, "popcorn"), target_knock=TargetTopple("approach", "lying")),
                "semantic: after its events: target-knock: popcorn cannot fall over",
            ),
            (
                lambda one: replace(
                    one,
                    target_switch=InstructionChange("grasp", "first"),
                    instruction_change=InstructionChange(to="stop"),
                ),
                "semantic: target-switch: with instruction_change, nobody could say",
            ),
            (
                lambda one: moved(replace(one, target_switch=InstructionChange(to="first")), "salad_dressing_1", x=0.5),
                "geometry: salad_dressing_1 is .* m from the robot",
            ),
            (lambda one: replace(one, start=Start(50)), "semantic: .* has 50 initial states, not 51"),
            (lambda one: replace(one, light=Light(-1.0)), "semantic: light: an intensity of -1"),
            (lambda one: replace(one, camera=Camera(yaw=60.0)), "unseen: the camera shows "),
            (lambda one: moved(one, "alphabet_soup_1", x=0.5), "geometry: .* m from the robot, which reaches 0.79 m"),
            (lambda one: moved(one, "alphabet_soup_1", x=0.135, y=0.49), "geometry: .*alphabet_soup_1"),  # the basket's
            (lambda one: swapped(one, "spaceship"), "semantic: .* are not the things of libero_object/0"),
            (lambda one: swapped(one, "ketchup", larger("popcorn")), "semantic: .* have one size"),
            (lambda one: swapped(one, "ketchup", added("wine_bottle", 0.11, -0.2)), "geometry: milk_1 and wine_bottle"),
            (
                lambda one: replace(one, confounders=(BEFORE,)),
                "unseen: the camera shows .* of alphabet_soup_1, usually",
            ),
        ],
    )
    def test_what_is_not_fair_is_refused_in_a_sentence(self, soup, varied, changed, problem):
        rejection = soup.check(changed(varied.nominal()))
        assert re.match(problem, f"{rejection.check}: {rejection.reason}")
