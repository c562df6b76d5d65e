"""Policies and simulators that break: an ERROR, and nothing of it in the next scene."""

from collections.abc import Callable

import numpy as np
import pytest

from tests.worlds.tabletop.sim.meddling import ANOTHER, NOMINAL, Meddle, Meddled, evaluate, is_lifted
from tests.worlds.tabletop.sim.scenes import CATALOGUE, put
from vlafuzz.errors import Cause, PolicyError
from vlafuzz.model.conditions import Conditions
from vlafuzz.model.outcome import Outcome, Verdict
from vlafuzz.policies.base import ActionChunk, Observation
from vlafuzz.policies.clients import wire
from vlafuzz.worlds.recording import Recording
from vlafuzz.worlds.tabletop.experts.expert import Expert
from vlafuzz.worlds.tabletop.sim.evaluator import ManiSkillEvaluator
from vlafuzz.worlds.tabletop.sim.world import World


@pytest.fixture(scope="module")
def broken_first() -> Callable[[Meddle], list[Outcome]]:
    """NOMINAL with a broken policy, then ANOTHER with a sound one, in the same evaluator."""
    policy = Meddled(raising)
    evaluator = ManiSkillEvaluator(Conditions(task="pick-up", min_distance=0.15), policy, CATALOGUE)

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


BROKEN = {
    "nan": (lambda _, a: [ActionChunk(a * np.nan)], "bad_action: expert: an action is not finite"),
    "infinite": (
        lambda _, a: [ActionChunk(a + np.inf)],
        "bad_action: expert: an action is not finite",
    ),
    "six numbers": (
        lambda _, a: [ActionChunk(a[:, :6])],
        "bad_action: expert: actions of shape (1, 6)",
    ),
    "no chunk axis": (lambda _, a: [ActionChunk(a[0])], "bad_action: expert: actions of shape (7,)"),
    "empty chunk": (
        lambda _, a: [ActionChunk(a[:0])],
        "bad_action: expert: actions of shape (0, 7)",
    ),
    "two chunks": (
        lambda _, a: [ActionChunk(a)] * 2,
        "bad_action: expert: 1 observations, 2 chunks",
    ),
    "none": (lambda *_: None, ""),
    "words": (lambda *_: [ActionChunk(np.array([["up"] * 7]))], ""),
    "raises": (raising, "remote: expert raised RuntimeError: out of memory"),
    "refuses": (failing("protocol"), "protocol: no answer within 10 s"),
}


@pytest.mark.parametrize(("meddle", "says"), BROKEN.values(), ids=BROKEN)
def test_a_policy_that_breaks_is_an_error_and_the_next_scene_is_as_ever(broken_first, known, meddle, says):
    broken, sound = broken_first(meddle)
    assert (broken.verdict, broken.rollouts, broken.lost_stage) == (Verdict.ERROR, (), None)
    assert broken.detail.startswith(f"policy: {says}")
    assert sound.verdict is Verdict.PASSED
    assert sound.rollouts[0].states_hash == known[1]


@pytest.mark.parametrize("cause", ["connect", "timeout"])
@pytest.mark.parametrize("lost", [1, 2, 3])
def test_a_rollout_whose_server_is_lost_is_begun_again_twice_at_most(known, monkeypatch, caplog, cause, lost):
    monkeypatch.setattr(wire, "PAUSES", (0.0, 0.0))
    policy = Meddled(failing(cause), episodes=lost)
    (outcome,) = evaluate(policy, NOMINAL)
    assert len(policy.started) == min(lost + 1, 3)
    assert len(caplog.records) == min(lost, 2)
    if lost < 3:
        assert [rollout.states_hash for rollout in outcome.rollouts] == known[:1]
    else:
        assert (outcome.verdict, outcome.detail) == (
            Verdict.ERROR,
            f"policy: {cause}: no answer within 10 s",
        )


def test_of_a_rollout_that_is_begun_again_nothing_stays_recorded(monkeypatch):
    def late_at_last(seen: Observation, actions: np.ndarray) -> list[ActionChunk]:
        return failing("timeout")() if seen.step == 3 else [ActionChunk(actions)]

    monkeypatch.setattr(wire, "PAUSES", (0.0, 0.0))
    recording = Recording(0)
    (outcome,) = evaluate(Meddled(late_at_last, episodes=1), NOMINAL, recording=recording)
    assert [seen.step for seen in recording.observations] == list(range(len(outcome.rollouts[0].actions)))


def test_a_policy_that_breaks_in_the_middle_of_a_rollout_leaves_nothing_behind(broken_first, known):
    def breaks_while_holding(observation: Observation, actions: np.ndarray) -> list[ActionChunk]:
        return [ActionChunk(actions * (np.nan if is_lifted(observation) else 1.0))]

    broken, sound = broken_first(breaks_while_holding)
    assert broken.verdict is Verdict.ERROR
    assert sound.rollouts[0].states_hash == known[1]


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
    assert (broken.verdict, broken.detail) == (
        Verdict.ERROR,
        "simulator: RuntimeError: PhysX: out of contact memory",
    )
    assert sound.rollouts[0].states_hash == known[1]


def test_an_option_that_was_not_applied_is_an_error(expert_on, monkeypatch):
    evaluator = expert_on("pick-up")
    evaluator.evaluate([NOMINAL])
    begin, aside = World.begin, [put("pepsi_can", 0.0, 0.1)]
    monkeypatch.setattr(World, "begin", lambda world, models, *_: begin(world, models, aside))
    (outcome,) = evaluator.evaluate([NOMINAL])
    assert outcome.verdict is Verdict.ERROR
    assert "pose of pepsi_can: asked for" in outcome.detail


def test_an_interruption_passes():
    with pytest.raises(KeyboardInterrupt):
        evaluate(Meddled(lambda *_: (_ for _ in ()).throw(KeyboardInterrupt)), NOMINAL)
