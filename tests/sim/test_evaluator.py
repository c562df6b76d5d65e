"""Scenes in, outcomes out: each verdict for its reason, and no scene has an effect on the next one."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from tests.sim.scenes import CATALOGUE, STILL, nominal, put
from vlafuzz.errors import Cause, SubjectError, UsageError
from vlafuzz.outcome import Outcome, Verdict
from vlafuzz.scene import Placement, Scene
from vlafuzz.sim.maniskill.evaluator import ManiSkillEvaluator
from vlafuzz.sim.maniskill.video import Recording
from vlafuzz.sim.maniskill.world import World
from vlafuzz.subjects import wire
from vlafuzz.subjects.base import ActionChunk, EpisodeStart, Observation, Subject
from vlafuzz.subjects.controls import Frozen, Random
from vlafuzz.subjects.expert import Expert
from vlafuzz.tasks.tabletop import TASKS

NOMINAL = nominal()
ANOTHER = replace(NOMINAL, targets=(put("sponge", 0.0, 0.1, 40.0),), instruction="pick up sponge")
AT_START = pytest.approx(0.0, abs=1e-3)


Meddle = Callable[[Observation, np.ndarray], object]


class Meddled:
    """An expert with something done to its answers, in its first episodes or in all of them."""

    def __init__(self, meddle: Meddle, episodes: int | None = None) -> None:
        self._expert = Expert()
        self.spec = self._expert.spec
        self.become(meddle, episodes)

    def become(self, meddle: Meddle, episodes: int | None = None) -> None:
        self._meddle, self._left = meddle, episodes
        self.started: list[EpisodeStart] = []

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        self.started += episodes
        self._expert.reset(episodes)

    def act(self, observations: Sequence[Observation]) -> object:
        (chunk,) = self._expert.act(observations)
        if self._left is not None and len(self.started) > self._left:
            return [chunk]
        return self._meddle(observations[0], chunk.actions)

    def close(self) -> None:
        self._expert.close()


def lets_go_at(moment: Callable[[Observation], bool], times: int = 1) -> Meddled:
    """When it has met that moment so many times it opens its gripper and stays."""
    met: list[bool] = []

    def meddle(observation: Observation, actions: np.ndarray) -> list[ActionChunk]:
        met.extend([True] if moment(observation) else [])
        return [ActionChunk(STILL[None] if len(met) >= times else actions)]

    return Meddled(meddle)


def is_lifted(observation: Observation) -> bool:
    return bool(observation.privileged.state.positions[0, 2] > 0.0615 + 0.025)


def evaluate(subject: Subject, *scenes: Scene, **options: object) -> list[Outcome]:
    evaluator = ManiSkillEvaluator(
        **{"task": scenes[0].task, "min_distance": 0.15} | options, subject=subject, catalogue=CATALOGUE
    )
    outcomes = evaluator.evaluate(scenes)
    evaluator.close()
    return outcomes


def test_the_instruction_changes_once_a_stage_is_reached():
    said: list[tuple[str, bool]] = []

    def listens(observation: Observation, actions: np.ndarray) -> list[ActionChunk]:
        said.append((observation.instruction, is_lifted(observation)))
        return [ActionChunk(actions)]

    stepwise = replace(NOMINAL, instruction="grasp it", then=("lift it", "hold it up"))
    (outcome,) = evaluate(Meddled(listens), stepwise)
    assert outcome.verdict is Verdict.PASSED
    assert list(dict.fromkeys(words for words, _ in said)) == ["grasp it", "lift it", "hold it up"]
    assert all(lifted for words, lifted in said if words == "hold it up")
    assert not any(lifted for words, lifted in said if words == "grasp it")


@pytest.fixture(scope="module")
def broken_first() -> Callable[[Meddle], list[Outcome]]:
    """NOMINAL with a broken subject, then ANOTHER with a sound one, in the same evaluator."""
    subject = Meddled(raising)
    evaluator = ManiSkillEvaluator("pick-up", subject, CATALOGUE, min_distance=0.15)

    def play(meddle: Meddle) -> list[Outcome]:
        subject.become(meddle, episodes=1)
        return evaluator.evaluate([NOMINAL, ANOTHER])

    yield play
    evaluator.close()


@pytest.fixture(scope="module")
def known(expert_on) -> list[str]:
    """The hashes of the expert's rollouts of NOMINAL and ANOTHER."""
    outcomes = expert_on("pick-up").evaluate([NOMINAL, ANOTHER])
    return [outcome.rollouts[0].states_hash for outcome in outcomes]


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


def test_outcomes_come_in_order_and_equal_scenes_have_equal_trajectories(expert_on, known):
    outcomes = expert_on("pick-up").evaluate([ANOTHER, NOMINAL, ANOTHER])
    assert [outcome.rollouts[0].states_hash for outcome in outcomes] == [known[1], known[0], known[1]]


@pytest.mark.parametrize(
    ("scene", "check", "says"),
    [
        (replace(NOMINAL, targets=(put("banana_", 0.0, 0.0, rest="lying"),)), "semantic", "banana_"),
        (nominal("put-on"), "semantic", "its task is 'put-on', not 'pick-up'"),
        (replace(NOMINAL, targets=(put("coke_can", 0.3, 0.0),)), "geometry", "the workspace ends at"),
        (replace(NOMINAL, confounders=(put("apple", -0.05, 0.1),)), "geometry", "less than 0.15 m"),
        (
            replace(NOMINAL, targets=(put("coke_can", 0.0, 0.0, quaternion=(0.95, 0.0, 0.312, 0.0)),)),
            "settling",
            "while settling",
        ),
    ],
    ids=["unknown object", "another task", "off the workspace", "too close", "leaning"],
)
def test_an_unfair_scene_is_invalid_with_its_reason_and_never_shown_to_the_subject(scene, check, says):
    subject = Meddled(lambda *_: pytest.fail("asked"))
    (outcome,) = evaluate(subject, scene, task="pick-up")
    assert (outcome.verdict, outcome.check, outcome.rollouts) == (Verdict.INVALID, check, ())
    assert says in outcome.detail


def test_a_scene_that_is_solved_from_the_start_is_invalid():
    cubes = (Placement("green_cube", "flat", 0.0, 0.0), Placement("yellow_cube", "flat", 0.0, 0.06))
    (outcome,) = evaluate(Frozen(), Scene("move-near", cubes, "move them"), min_distance=0.0)
    assert (outcome.verdict, outcome.check) == (Verdict.INVALID, "solved")


def test_unchecked_scenes_are_run_as_they_are():
    close = replace(NOMINAL, confounders=(put("apple", -0.05, 0.1),))
    assert evaluate(Frozen(), close, checked=False)[0].verdict is Verdict.FAILED


def raising(*_: object) -> None:
    raise RuntimeError("out of memory")


def failing(cause: Cause) -> Meddle:
    def refuse(*_: object) -> None:
        raise SubjectError("no answer within 10 s", cause=cause)

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
def test_a_subject_that_breaks_is_an_error_and_the_next_scene_is_as_ever(broken_first, known, meddle, says):
    broken, sound = broken_first(meddle)
    assert (broken.verdict, broken.rollouts, broken.lost_stage) == (Verdict.ERROR, (), None)
    assert broken.detail.startswith(f"subject: {says}")
    assert sound.verdict is Verdict.PASSED
    assert sound.rollouts[0].states_hash == known[1]


@pytest.mark.parametrize("cause", ["connect", "timeout"])
@pytest.mark.parametrize("lost", [1, 2, 3])
def test_a_rollout_whose_server_is_lost_is_begun_again_twice_at_most(known, monkeypatch, caplog, cause, lost):
    monkeypatch.setattr(wire, "PAUSES", (0.0, 0.0))
    subject = Meddled(failing(cause), episodes=lost)
    (outcome,) = evaluate(subject, NOMINAL)
    assert len(subject.started) == min(lost + 1, 3)
    assert len(caplog.records) == min(lost, 2)
    if lost < 3:
        assert [rollout.states_hash for rollout in outcome.rollouts] == known[:1]
    else:
        assert (outcome.verdict, outcome.detail) == (
            Verdict.ERROR,
            f"subject: {cause}: no answer within 10 s",
        )


def test_of_a_rollout_that_is_begun_again_nothing_stays_recorded(monkeypatch):
    def late_at_last(seen: Observation, actions: np.ndarray) -> list[ActionChunk]:
        return failing("timeout")() if seen.step == 3 else [ActionChunk(actions)]

    monkeypatch.setattr(wire, "PAUSES", (0.0, 0.0))
    recording = Recording(0)
    (outcome,) = evaluate(Meddled(late_at_last, episodes=1), NOMINAL, recording=recording)
    assert [seen.step for seen in recording.observations] == list(range(len(outcome.rollouts[0].actions)))


def test_a_subject_that_breaks_in_the_middle_of_a_rollout_leaves_nothing_behind(broken_first, known):
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


@pytest.mark.parametrize(
    ("criteria", "verdict", "lost", "reached"),
    [
        ("strict", Verdict.FAILED, "success", ("grasp", "lift")),
        ("published", Verdict.PASSED, None, ("grasp", "lift", "success")),
    ],
)
def test_who_lets_go_too_early_passes_by_the_published_criteria_only(criteria, verdict, lost, reached):
    (outcome,) = evaluate(lets_go_at(is_lifted, times=3), NOMINAL, criteria=criteria)
    assert (outcome.verdict, outcome.lost_stage) == (verdict, lost)
    assert outcome.rollouts[0].reached == reached
    assert outcome.rollouts[0].published_success


def test_a_success_that_the_published_criteria_do_not_see_fails_at_the_last_stage(monkeypatch):
    monkeypatch.setitem(TASKS, "pick-up", replace(TASKS["pick-up"], published=lambda _: False))
    (outcome,) = evaluate(Expert(), NOMINAL, criteria="published")
    assert (outcome.verdict, outcome.lost_stage) == (Verdict.FAILED, "success")
    assert outcome.progress < 1


def test_other_criteria_are_refused():
    with pytest.raises(UsageError, match="criteria: 'lenient'") as caught:
        evaluate(Frozen(), NOMINAL, criteria="lenient")
    assert caught.value.hint == "strict or published"


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
    subject = Meddled(lambda _, a: [ActionChunk(a)])
    evaluate(subject, NOMINAL, ANOTHER, repeats=2, seed=3)
    assert len({start.episode for start in subject.started}) == 4
    assert [start.seed for start in subject.started] == [3, 4, 3, 4]
    assert [start.instruction for start in subject.started] == [NOMINAL.instruction] * 2 + [
        "pick up sponge"
    ] * 2


def test_the_recorded_actions_are_what_was_executed(env, known, expert_on):
    (rollout,) = expert_on("pick-up").evaluate([NOMINAL])[0].rollouts
    state = env.begin(NOMINAL)
    for action in rollout.actions:
        state = env.advance(action.astype(np.float64), "current")
    assert state.held == 0
    assert env.monitor.success_once


def test_a_scaled_object_is_judged_at_its_own_size():
    placed = (put("sponge", -0.05, -0.1, scale=0.6), put("orange", -0.05, 0.12))
    assert (
        evaluate(Expert(), Scene("move-near", placed, "move sponge near orange"))[0].verdict is Verdict.PASSED
    )


@pytest.mark.slow
@pytest.mark.parametrize("task", TASKS)
def test_crashes_of_many_rollouts_never_reach_the_others(task):
    rng = np.random.default_rng(0)
    subject = Meddled(lambda _, a: [ActionChunk(a * (np.nan if rng.random() < 0.05 else 1.0))], episodes=20)
    outcomes = evaluate(subject, *[nominal(task)] * 30)
    assert {outcome.verdict for outcome in outcomes[20:]} == {Verdict.PASSED}
    assert len({outcome.rollouts[0].states_hash for outcome in outcomes if outcome.rollouts}) == 1
