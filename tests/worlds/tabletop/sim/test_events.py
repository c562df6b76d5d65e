"""What happens in the middle of an episode: when, how much, and that a scene stays fair and solvable."""

from dataclasses import replace

import numpy as np
import pytest

from tests.worlds.tabletop.sim.meddling import NOMINAL, Meddled
from tests.worlds.tabletop.sim.scenes import CATALOGUE, CROWDED, STILL, evaluate, nominal, put
from vlafuzz.model import Scene, Verdict
from vlafuzz.model.scene import (
    EVENTS,
    CameraBump,
    ControlStall,
    GripSlip,
    GripWeak,
    InstructionChange,
    LightSwitch,
    Newcomer,
    PictureLoss,
    Slide,
    TargetTopple,
)
from vlafuzz.policies.base import ActionChunk
from vlafuzz.worlds.events import afterwards
from vlafuzz.worlds.manipulation.camera import camera_pose
from vlafuzz.worlds.tabletop.fairness.checks import check_events
from vlafuzz.worlds.tabletop.sim.env import TabletopEnv

SECOND = 5  # control steps
ASIDE = Slide("start", 0.06, 90.0)


def begun(env: TabletopEnv, scene: Scene, steps: int) -> TabletopEnv:
    """An environment so many steps after the beginning of a scene, in which the robot stood still."""
    env.begin(scene)
    env.check(scene)
    for _ in range(steps):
        env.advance(STILL)
    return env


def test_a_target_slides_to_its_new_place_after_a_second_and_stays_there(env):
    scene = replace(nominal(), target_slide=ASIDE)
    start = env.begin(scene).positions[0]
    waited = [env.advance(STILL).positions[0] - start for _ in range(SECOND + 8)]
    assert np.abs(waited[SECOND - 1]).max() < 0.002
    assert 0.01 < waited[SECOND][1] < 0.05  # it is on its way, not there at once
    assert waited[-1] == pytest.approx([0.0, 0.06, 0.0], abs=0.004)
    assert afterwards(scene).targets[0].y == pytest.approx(scene.targets[0].y + 0.06)


def test_a_bumped_camera_and_a_switched_lamp_stay_as_they_are_from_then_on(env):
    bump, switch = CameraBump("start", pitch=2.0, yaw=-1.0), LightSwitch("start", 0.5)
    scene = replace(nominal(), camera_bump=bump, light_switch=switch)
    begun(env, scene, SECOND)
    assert (env.light, env.view.axes.tolist()) == (1.0, camera_pose(env.rig.view).axes.tolist())
    for _ in range(3):
        env.advance(STILL)
        turned = camera_pose(env.rig.view, afterwards(scene).camera)
        assert env.light == 0.5
        assert env.view.axes == pytest.approx(turned.axes)
    begun(env, nominal(), 1)
    assert env.light == 1.0


@pytest.mark.render
def test_pictures_freeze_or_turn_black_for_so_many_steps_and_come_back(seeing):
    for loss in (PictureLoss("start", 3), PictureLoss("start", 3, "black")):
        moving = replace(nominal(), picture_loss=loss, light_switch=LightSwitch("start", 2.0))
        seeing.begin(moving)
        seen = [seeing.seen("front")]
        for _ in range(SECOND + 4):
            seeing.advance(STILL)
            seen.append(seeing.seen("front"))
        lost = seen[SECOND + 1 : SECOND + 4]
        expected = seen[SECOND] if loss.shows == "frozen" else np.zeros_like(seen[0])
        assert all(np.array_equal(picture, expected) for picture in lost)
        assert seen[SECOND + 4].mean() > seen[SECOND].mean() + 5


def test_a_robot_that_stalls_stands_still_and_goes_on_with_what_it_is_told_then(env):
    forward = np.array([0.02, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    env.begin(replace(nominal(), control_stall=ControlStall("start", 4)))
    places = [env.advance(forward).tcp[0] for _ in range(SECOND + 7)]
    assert places[SECOND + 3] - places[SECOND] < 0.01  # it comes to rest
    assert places[-1] - places[SECOND + 3] > 0.03


def test_a_target_that_topples_lies_where_it_stood(env):
    scene = replace(nominal(), target_topple=TargetTopple("start", "lying"))
    assert scene.targets[0].rest == "standing"
    env.begin(scene)
    states = [env.advance(STILL) for _ in range(SECOND + 8)]
    assert states[SECOND - 1].rotations[0][2, 2] > 0.99
    assert abs(states[-1].rotations[0][2, 2]) < 0.1
    assert states[-1].positions[0][:2] == pytest.approx(states[0].positions[0][:2], abs=0.01)
    assert afterwards(scene).targets[0].rest == "lying"


CHANGED = InstructionChange("grasp", "first")


def test_a_newcomer_stands_in_its_place_a_step_after_it_is_due_and_is_nowhere_before(env):
    scene = replace(CROWDED, newcomer=Newcomer("start", "first"))
    env.begin(scene)
    env.check(scene)
    states = [env.advance(STILL) for _ in range(SECOND + 6)]
    place = env.world.place(CATALOGUE["green_cube"], scene.confounders[0]).p
    assert [1 in state.there for state in states] == [step >= SECOND for step in range(SECOND + 6)]
    assert all(np.abs(state.positions[1] - place).max() < 1e-3 for state in states[SECOND + 1 :])


def test_a_newcomer_waits_until_the_hand_is_out_of_its_way(env):
    down, aside = np.array([0.0, 0, -0.05, 0, 0, 0, 1]), np.array([0.0, -0.05, 0, 0, 0, 0, 1])
    x, y, _ = env.begin(NOMINAL).tcp
    scene = replace(NOMINAL, targets=(put("coke_can", x, y + 0.25),), confounders=(put("apple", x, y),))
    env.begin(replace(scene, newcomer=Newcomer("start", "first")))
    there = [1 in env.advance(action).there for action in [down] * 4 + [STILL] * 6 + [aside] * 6]
    assert there.index(True) > 10


def test_an_instruction_changes_for_the_policy_and_for_what_counts_as_success(expert_on):
    heard = []

    def watch(seen, inner):
        heard.append(seen.instruction)
        return [ActionChunk(STILL[None])]

    evaluate(Meddled(watch), replace(CROWDED, instruction_change=InstructionChange("start", "first")))
    assert list(dict.fromkeys(heard)) == [CROWDED.instruction, "pick up green cube"]
    assert heard.index("pick up green cube") == SECOND + 1
    solved, usual = expert_on("pick-up").evaluate([replace(CROWDED, instruction_change=CHANGED), CROWDED])
    assert (solved.verdict, usual.verdict) == (Verdict.PASSED, Verdict.PASSED)
    (deaf,) = evaluate(repeating(usual.rollouts[0].actions), replace(CROWDED, instruction_change=CHANGED))
    assert (deaf.verdict, deaf.lost_stage) == (Verdict.FAILED, "grasp")


STOPPED = InstructionChange("grasp", "stop")


def test_whoever_is_told_to_stop_passes_by_standing_still_and_fails_by_going_on_or_letting_go(expert_on):
    usual = nominal("put-on")
    scene = replace(usual, instruction_change=STOPPED)
    solved, unaware = expert_on("put-on").evaluate([scene, usual])
    done = solved.rollouts[0]
    assert (solved.verdict, unaware.verdict) == (Verdict.PASSED, Verdict.PASSED)
    still = np.flatnonzero((done.actions[:, :6] == 0).all(axis=1))
    assert list(still) == list(range(still[0], len(done.actions)))  # from the word on
    assert (done.recovery, done.success_at_end) == (None, True)

    def let_go(seen, inner):
        return [ActionChunk(STILL[None] if seen.step > still[0] + SECOND else inner)]

    policies = repeating(unaware.rollouts[0].actions), repeating(done.actions), Meddled(let_go)
    gone_on, again, dropped = (evaluate(policy, scene)[0] for policy in policies)
    assert [one.verdict for one in (gone_on, again, dropped)] == [Verdict.FAILED, Verdict.PASSED, Verdict.FAILED]
    assert gone_on.lost_stage == "success"


def test_a_weak_grip_presses_less_from_then_on_and_as_usual_in_the_next_scene(env):
    closing = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1.0])

    def closed(scene: Scene) -> float:
        env.begin(scene)
        return [env.advance(closing if step > SECOND else STILL).opening for step in range(SECOND + 3)][-1]

    usual = closed(nominal())
    assert closed(replace(nominal(), grip_weak=GripWeak("start", 0.02))) > usual + 0.01
    assert closed(nominal()) == usual


def repeating(actions: np.ndarray) -> Meddled:
    """Does what was done before, whatever it sees."""
    return Meddled(lambda seen, _: [ActionChunk(actions[min(seen.step, len(actions) - 1)][None])])


@pytest.mark.parametrize(
    "event",
    [
        {"target_slide": Slide("approach", 0.08, 120.0)},
        {"grip_slip": GripSlip("carry", 3)},
        {"target_topple": TargetTopple("approach", "lying"), "grip_weak": GripWeak("grasp", 0.3)},
        {"control_stall": ControlStall("approach", 6), "camera_bump": CameraBump("grasp", 1.0, 2.0, 1.0)},
        {"newcomer": Newcomer("approach", "first"), "confounders": CROWDED.confounders},
    ],
    ids=["slide", "slip", "topple", "stall", "newcomer"],
)
def test_the_expert_notices_and_solves_the_scene_which_repeating_its_usual_actions_does_not(expert_on, event):
    usual, scene = nominal(), replace(nominal(), **event)
    (before,) = expert_on("pick-up").evaluate([usual])
    solved, again = expert_on("pick-up").evaluate([scene, scene])
    assert solved.verdict is Verdict.PASSED
    assert 0 < solved.rollouts[0].recovery < 20
    assert solved.rollouts[0].states_hash == again.rollouts[0].states_hash != before.rollouts[0].states_hash
    if not event.keys() & {"grip_slip", "newcomer"}:  # a closing hand may still hold it, a newcomer stand aside
        (blind,) = evaluate(repeating(before.rollouts[0].actions), scene)
        assert blind.verdict is Verdict.FAILED


def test_the_actions_of_a_solution_solve_the_scene_again_open_loop(expert_on):
    scene = replace(nominal("put-on"), goal_slide=Slide("carry", 0.08, 0.0))
    (solved,) = expert_on("put-on").evaluate([scene])
    first, second = evaluate(repeating(solved.rollouts[0].actions), scene, scene)
    assert (solved.verdict, first.verdict) == (Verdict.PASSED, Verdict.PASSED)
    assert first.rollouts[0].states_hash == second.rollouts[0].states_hash


@pytest.mark.parametrize(
    ("scene", "says"),
    [
        (replace(nominal(), target_slide=Slide("start", 0.5, 0.0)), "after its events: "),
        (
            replace(NOMINAL, confounders=(put("coke_can", -0.05, 0.12),), target_slide=Slide("start", 0.24, 90)),
            "while things slide: ",
        ),
        (replace(nominal(), camera_bump=CameraBump("start", yaw=40.0)), "after its events: "),
        (
            replace(NOMINAL, targets=(put("green_cube", 0.0, 0.0),), target_topple=TargetTopple("start", "lying")),
            "after its events: green_cube: unknown rest pose 'lying', it has flat",
        ),
        (
            replace(nominal(), instruction_change=InstructionChange("start", "second")),
            "instruction-change: there is no second other thing",
        ),
        (replace(CROWDED, newcomer=Newcomer("start", "third")), "newcomer: there is no third other thing"),
        (
            replace(CROWDED, newcomer=Newcomer("start", "first"), instruction_change=CHANGED),
            "instruction-change: it names no other thing where one is put down",
        ),
        (replace(nominal(), instruction_change=STOPPED), "instruction-change: pick-up may end as after 'stop'"),
        (
            replace(nominal(), target_knock=TargetTopple("start", "lying")),
            "target-knock: the tabletop has no such event",
        ),
        (
            replace(nominal("put-on"), instruction_change=STOPPED, grip_weak=GripWeak("start", 0.2)),
            "instruction-change: after 'stop', another event would let something fall",
        ),
    ],
    ids=[
        "off the table",
        "through a can",
        "out of the picture",
        "that cannot lie",
        "to nothing",
        "nothing comes",
        "to what comes",
        "in hand",
        "of other worlds",
        "to fall",
    ],
)
def test_a_scene_is_only_fair_if_what_happens_in_it_is(scene, says):
    rejection = check_events(scene, CATALOGUE, 0.1, None)
    assert rejection is not None
    assert rejection.reason.startswith(says)
    assert check_events(replace(scene, **EVENTS), CATALOGUE, 0.1, None) is None
