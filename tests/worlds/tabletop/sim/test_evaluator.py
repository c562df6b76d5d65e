"""Scenes in, outcomes out: each verdict for its reason, and no scene has an effect on the next one."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tests.worlds.tabletop.sim.meddling import ANOTHER, AT_START, NOMINAL, Meddle, Meddled, is_lifted, lets_go_at
from tests.worlds.tabletop.sim.scenes import STILL, evaluate, evaluator_of, nominal, pick_up, put
from vlafuzz.errors import Cause, PolicyError, UsageError
from vlafuzz.model import Conditions, Outcome, Scene, Verdict
from vlafuzz.policies.base import ActionChunk, Observation
from vlafuzz.policies.clients import wire
from vlafuzz.policies.controls import Frozen, Random
from vlafuzz.worlds.recording import Recording
from vlafuzz.worlds.tabletop.experts.expert import Expert
from vlafuzz.worlds.tabletop.experts.pinhole import Pinhole
from vlafuzz.worlds.tabletop.sim.world import World
from vlafuzz.worlds.tabletop.space import load_operators
from vlafuzz.worlds.tabletop.tasks import TASKS
from vlafuzz.worlds.tabletop.world import WORLD


@pytest.mark.parametrize("task", TASKS)
def test_the_expert_passes_the_nominal_scene_through_all_stages(expert_on, task):
    (outcome,) = expert_on(task).evaluate([nominal(task)])
    assert (outcome.verdict, outcome.lost_stage, outcome.progress) == (Verdict.PASSED, None, 1.0)
    assert outcome.rollouts[0].reached == TASKS[task].stage_names
    assert outcome.rollouts[0].success_at_end


@pytest.mark.parametrize("task", TASKS)
def test_who_never_moves_fails_at_the_grasp(task):
    (outcome,) = evaluate(Frozen(), nominal(task))
    assert (outcome.verdict, outcome.lost_stage, outcome.progress) == (Verdict.FAILED, "grasp", AT_START)
    assert (outcome.rollouts[0].reached, outcome.rollouts[0].steps) == ((), 80)


LEANING = put("coke_can", 0.0, 0.0, quaternion=(0.95, 0.0, 0.312, 0.0))


@pytest.mark.parametrize(
    ("scene", "check", "says"),
    [
        (replace(NOMINAL, targets=(put("banana_", 0.0, 0.0, rest="lying"),)), "semantic", "banana_"),
        (nominal("put-on"), "semantic", "its task is 'put-on', not 'pick-up'"),
        (replace(NOMINAL, targets=(put("coke_can", 0.3, 0.0),)), "geometry", "the workspace ends at"),
        (replace(NOMINAL, confounders=(put("apple", -0.05, 0.1),)), "geometry", "less than 0.15 m"),
        (replace(NOMINAL, targets=(LEANING,)), "settling", "while settling"),
    ],
    ids=["unknown object", "another task", "off the workspace", "too close", "leaning"],
)
def test_an_unfair_scene_is_invalid_with_its_reason_and_never_shown_to_the_policy(scene, check, says):
    policy = Meddled(lambda *_: pytest.fail("asked"))
    (outcome,) = evaluate(policy, scene, task="pick-up")
    assert (outcome.verdict, outcome.check, outcome.rollouts) == (Verdict.INVALID, check, ())
    assert says in outcome.detail


def test_a_scene_is_judged_by_the_picture_that_its_policy_gets():
    """Under this light, table and spoon are both white in outlines, but not in a rendered picture."""
    bright = pick_up(put("spoon", -0.05, 0.0), light=6.0)
    visible = {"min_distance": 0.15, "visible": load_operators().conditions["world"]["visible"]}
    (outcome,) = evaluate(Pinhole(), bright, world=visible)
    assert (outcome.verdict, outcome.check) == (Verdict.INVALID, "unseen")
    assert outcome.detail.startswith("spoon: only 0/255 apart from the table under light × 6; at least 4/255")
    assert evaluate(Frozen(), bright, world=visible)[0].verdict is Verdict.FAILED
    assert evaluate(Pinhole(), bright)[0].verdict is not Verdict.INVALID


@pytest.mark.parametrize(("stop_early", "after"), [(False, 10), (True, 0)])
def test_a_rollout_goes_on_for_ten_steps_after_success(stop_early, after):
    (rollout,) = evaluate(Expert(), NOMINAL, stop_early=stop_early)[0].rollouts
    first = int(np.argmax(rollout.trace == 1.0))
    assert rollout.steps == len(rollout.actions) == first + 1 + after
    assert rollout.steps < 80


def test_who_lets_go_after_success_has_succeeded_once_but_not_at_the_end():
    (outcome,) = evaluate(lets_go_at(lambda observation: observation.privileged.done), NOMINAL)
    assert outcome.verdict is Verdict.PASSED
    assert (outcome.rollouts[0].success_once, outcome.rollouts[0].success_at_end) == (True, False)


def test_repeats_have_seeds_of_their_own_and_are_repeatable():
    (outcome,) = evaluate(Random(), NOMINAL, repeats=3, seed=5)
    hashes = [rollout.states_hash for rollout in outcome.rollouts]
    assert len(set(hashes)) == 3
    (shifted,) = evaluate(Random(), NOMINAL, repeats=2, seed=6)
    assert [rollout.states_hash for rollout in shifted.rollouts] == hashes[1:]


def test_one_failed_repeat_fails_the_scene_with_the_worst_progress():
    frozen_once = Meddled(lambda *_: [ActionChunk(STILL[None])], episodes=1)
    (outcome,) = evaluate(frozen_once, NOMINAL, repeats=2)
    assert [rollout.success_once for rollout in outcome.rollouts] == [False, True]
    assert (outcome.verdict, outcome.lost_stage, outcome.progress) == (Verdict.FAILED, "grasp", AT_START)


def test_every_rollout_has_an_episode_name_of_its_own_and_hears_the_instruction():
    policy = Meddled(lambda _, a: [ActionChunk(a)])
    evaluate(policy, NOMINAL, ANOTHER, repeats=2, seed=3)
    assert len({start.episode for start in policy.started}) == 4
    assert [start.seed for start in policy.started] == [3, 4, 3, 4]
    said = [start.instruction for start in policy.started]
    assert said == [NOMINAL.instruction, NOMINAL.instruction, "pick up sponge", "pick up sponge"]


def test_the_recorded_actions_are_what_was_executed(env, known, expert_on):
    (rollout,) = expert_on("pick-up").evaluate([NOMINAL])[0].rollouts
    state = env.begin(NOMINAL)
    for action in rollout.actions:
        state = env.advance(action.astype(np.float64), "current")
    assert state.held == 0
    assert env.monitor.success_once


def test_a_scaled_object_is_judged_at_its_own_size():
    placed = (put("sponge", -0.05, -0.1, scale=0.6), put("orange", -0.05, 0.12))
    (outcome,) = evaluate(Expert(), Scene("move-near", placed, "move sponge near orange"))
    assert outcome.verdict is Verdict.PASSED


@pytest.fixture(scope="module")
def broken_first() -> Callable[[Meddle], list[Outcome]]:
    """NOMINAL with a broken policy, then ANOTHER with a sound one, in the same evaluator."""
    policy = Meddled(raising)
    evaluator = evaluator_of(policy)

    def play(meddle: Meddle) -> list[Outcome]:
        policy.become(meddle, episodes=1)
        return evaluator.evaluate([NOMINAL, ANOTHER])

    yield play
    evaluator.close()


def raising(*_: object) -> None:
    raise RuntimeError("out of memory")


def failing(cause: Cause) -> Meddle:
    def refuse(*_: object) -> None:
        raise PolicyError("no answer within 10 s", cause=cause)

    return refuse


@pytest.mark.parametrize(
    ("meddle", "says"),
    [
        (lambda *_: None, ""),
        (raising, "remote: expert raised RuntimeError: out of memory"),
        (
            lambda seen, a: [ActionChunk(a * (np.nan if is_lifted(seen) else 1.0))],
            "bad_action: expert: an action is not",
        ),
    ],
    ids=["none", "raises", "breaks while holding"],
)
def test_a_policy_that_breaks_is_an_error_and_the_next_scene_is_as_ever(broken_first, known, meddle, says):
    broken, sound = broken_first(meddle)
    assert (broken.verdict, broken.rollouts, broken.lost_stage) == (Verdict.ERROR, (), None)
    assert broken.detail.startswith(f"policy: {says}")
    assert sound.verdict is Verdict.PASSED
    assert sound.rollouts[0].states_hash == known[1]


@pytest.mark.parametrize(("cause", "lost"), [("timeout", 1), ("connect", 2), ("timeout", 3)])
def test_a_rollout_whose_server_is_lost_is_begun_again_twice_at_most(known, monkeypatch, caplog, cause, lost):
    monkeypatch.setattr(wire, "PAUSES", (0.0, 0.0))
    policy = Meddled(failing(cause), episodes=lost)
    (outcome,) = evaluate(policy, NOMINAL)
    assert len(policy.started) == min(lost + 1, 3)
    assert len(caplog.records) == min(lost, 2)
    if lost < 3:
        assert [rollout.states_hash for rollout in outcome.rollouts] == known[:1]
    else:
        assert outcome.verdict is Verdict.ERROR
        assert outcome.detail == f"policy: {cause}: no answer within 10 s"


def test_of_a_rollout_that_is_begun_again_nothing_stays_recorded(monkeypatch):
    def late_at_last(seen: Observation, actions: np.ndarray) -> list[ActionChunk]:
        return failing("timeout")() if seen.step == 3 else [ActionChunk(actions)]

    monkeypatch.setattr(wire, "PAUSES", (0.0, 0.0))
    recording = Recording(0)
    (outcome,) = evaluate(Meddled(late_at_last, episodes=1), NOMINAL, recording=recording)
    assert [seen.step for seen in recording.observations] == list(range(len(outcome.rollouts[0].actions)))


@pytest.mark.parametrize("crashing", [0, 9])
def test_a_crash_of_the_simulator_is_an_error_and_the_next_scene_is_as_ever(known, monkeypatch, crashing):
    step, calls = World.step, []

    def crashes_once(world: World, *arguments: object) -> object:
        calls.append(world)
        if len(calls) == crashing + 1:
            for entity in world.scene.entities:  # a crash may leave anything behind
                world.scene.remove_entity(entity)
            raise RuntimeError("PhysX: out of contact memory")
        return step(world, *arguments)

    monkeypatch.setattr(World, "step", crashes_once)
    broken, sound = evaluate(Expert(), NOMINAL, ANOTHER)
    assert broken.verdict is Verdict.ERROR
    assert broken.detail == "simulator: RuntimeError: PhysX: out of contact memory"
    assert sound.rollouts[0].states_hash == known[1]


def test_an_option_that_was_not_applied_is_an_error(expert_on, monkeypatch):
    evaluator = expert_on("pick-up")
    evaluator.evaluate([NOMINAL])
    begin, aside = World.begin, [put("pepsi_can", 0.0, 0.1)]
    monkeypatch.setattr(World, "begin", lambda world, models, *_: begin(world, models, aside))
    (outcome,) = evaluator.evaluate([NOMINAL])
    assert outcome.verdict is Verdict.ERROR
    assert "pose of pepsi_can: asked for" in outcome.detail


@pytest.mark.parametrize(
    ("former", "says"),
    [
        ({"world": {"placement": "published"}}, "placement published: objects are no longer dropped"),
        ({"criteria": "published"}, "criteria published: success is no longer judged"),
    ],
)
def test_conditions_of_former_versions_are_refused(former, says):
    with pytest.raises(UsageError, match=says):
        WORLD.evaluator(Conditions(task="pick-up", **former), Frozen(), None, recording=None, checked=True)


def test_an_interruption_passes():
    with pytest.raises(KeyboardInterrupt):
        evaluate(Meddled(lambda *_: (_ for _ in ()).throw(KeyboardInterrupt)), NOMINAL)
