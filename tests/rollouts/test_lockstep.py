"""Several scenes at a time in one process: what the policy is asked, and what scenes do to each other."""

from collections.abc import Iterator
from functools import partial

import pytest

from tests.doubles import failed, scene
from tests.rollouts.models import Counter
from tests.search.worlds import sampled
from tests.worlds.tabletop.sim.scenes import CATALOGUE
from vlafuzz.errors import PolicyError
from vlafuzz.model import Conditions, Outcome, Scene, Verdict
from vlafuzz.policies.base import EpisodeStart, Observation, Policy
from vlafuzz.policies.harness import Harness
from vlafuzz.rollouts.executor import LocalExecutor
from vlafuzz.rollouts.lockstep import LockstepExecutor, Seeded
from vlafuzz.rollouts.registry import Place, executor_at
from vlafuzz.worlds.evaluator import Evaluation
from vlafuzz.worlds.tabletop.experts.pinhole import Pinhole
from vlafuzz.worlds.tabletop.sim.env import ManiSkillEvaluator
from vlafuzz.worlds.tabletop.sim.world import World

LONG, SHORT, JUMP, LATE = (scene(light=light) for light in (4.0, 2.0, 1.0, 0.5))


class Asking:
    """Asks a ``Counter`` four or two times. Tenths of the progress: its last answer; hundredths: the seed."""

    def __init__(self, policy: Policy) -> None:
        self._policy = policy

    def evaluation(self, scene: Scene, seed: int | None = None) -> Evaluation:
        word = "jump" if scene == JUMP else "move"
        harness = Harness(self._policy, EpisodeStart("same name", word, scene.task, 0))
        if scene == LATE:
            yield 0.05
        for step in range(4 if scene == LONG else 2):
            try:
                chunk = yield Observation("same name", step, word)
            except PolicyError as error:
                return Outcome.error(str(error))
            assert chunk is not None
            last = next(iter(harness.actions(chunk)))[0]
        return failed(last / 10 + (seed or 0) / 100)

    def close(self) -> None:
        pass


@pytest.fixture
def counter() -> Counter:
    return Counter()


@pytest.fixture
def executor(counter: Counter) -> LockstepExecutor:
    return LockstepExecutor(Asking, counter, lanes=3)


def progress(executor: LockstepExecutor, *scenes: Seeded) -> list[float]:
    results = dict(executor.run(enumerate(scenes)))
    return [results[tag].progress for tag in range(len(scenes))]


def test_lanes_share_the_calls_of_the_policy_and_are_refilled_at_once(executor, counter):
    assert progress(executor, LONG, SHORT, SHORT, SHORT) == pytest.approx([0.4, 0.2, 0.2, 0.2])
    assert counter.batches == [3, 3, 2, 2]


def test_rollouts_of_the_same_name_do_not_meet_and_each_of_them_is_ended(executor, counter):
    assert progress(executor, SHORT, SHORT, SHORT) == pytest.approx([0.2] * 3)
    assert len(set(counter.finished)) == 3


def test_a_scene_may_have_its_own_seed(executor):
    assert progress(executor, (LONG, 1), (SHORT, 2), SHORT) == pytest.approx([0.41, 0.22, 0.2])


def test_an_answer_that_fails_is_an_error_of_its_scene_only(executor):
    results = dict(executor.run(enumerate([SHORT, JUMP, LONG])))
    assert "cannot jump" in results[1].detail
    assert [results[tag].progress for tag in (0, 2)] == pytest.approx([0.2, 0.4])


def test_a_lane_that_pauses_holds_no_other_lane_up(executor, counter):
    done = [tag for tag, _ in executor.run(enumerate([LATE, LONG]))]
    assert done == [1, 0]
    assert counter.batches[:4] == [1] * 4


def test_scenes_are_pulled_when_there_is_a_lane_for_them(executor):
    pulled = []

    def scenes() -> Iterator[tuple[int, Scene]]:
        for tag, one in enumerate([LONG, LONG, SHORT, SHORT, SHORT]):
            pulled.append(tag)
            yield tag, one

    results = executor.run(scenes())
    assert (next(results)[0], pulled) == (2, [0, 1, 2])
    assert (next(results)[0], pulled[-1]) in {(0, 3), (1, 3), (3, 3)}


def test_a_source_that_has_nothing_while_nothing_runs_is_a_bug(executor):
    with pytest.raises(RuntimeError, match="neither a scene"):
        list(executor.run([None]))


def test_a_run_that_is_left_early_leaves_nothing_behind(executor):
    results = executor.run(enumerate([SHORT, LONG, LONG]))
    next(results)
    results.close()
    assert progress(executor, SHORT, LONG) == pytest.approx([0.2, 0.4])


class Batching(Counter):
    answers_batches = True


@pytest.mark.parametrize(
    ("policy", "kind"), [(Batching(8), LockstepExecutor), (Batching(1), LocalExecutor), (Counter(8), LocalExecutor)]
)
def test_policies_behind_servers_that_take_batches_get_lanes(policy, kind):
    assert type(executor_at(Place(), Asking, policy)) is kind


CONDITIONS = Conditions(task="pick-up", world={"min_distance": 0.15}, repeats=2)
make = partial(ManiSkillEvaluator, CONDITIONS, catalogue=CATALOGUE)


def row(outcome: Outcome) -> tuple[object, ...]:
    hashes = [rollout.states_hash for rollout in outcome.rollouts]
    return outcome.verdict, outcome.progress, outcome.lost_stage, outcome.detail, hashes


@pytest.fixture(scope="module")
def alone() -> list[tuple[object, ...]]:
    """Five scenes of the simulator, one after the other."""
    evaluator = make(Pinhole())
    outcomes = evaluator.evaluate(sampled(5))
    evaluator.close()
    return list(map(row, outcomes))


def together() -> list[tuple[object, ...]]:
    """The same scenes, three at a time."""
    executor = LockstepExecutor(make, Pinhole(), lanes=3)
    results = dict(executor.run(enumerate(sampled(5))))
    executor.close()
    return [row(results[tag]) for tag in range(5)]


def test_scenes_go_through_the_same_states_as_alone(alone):
    assert together() == alone
    assert {verdict for verdict, *_ in alone} >= {Verdict.PASSED, Verdict.FAILED}


def test_a_crash_of_one_simulator_leaves_the_others_as_they_are(alone, monkeypatch):
    step, calls = World.step, []

    def crashes_once(world: World, *arguments: object) -> object:
        calls.append(world)
        if len(calls) == 50:
            raise RuntimeError("PhysX: out of contact memory")
        return step(world, *arguments)

    monkeypatch.setattr(World, "step", crashes_once)
    rows = together()
    (broken,) = [index for index, (verdict, *_) in enumerate(rows) if verdict is Verdict.ERROR]
    assert rows[:broken] + rows[broken + 1 :] == alone[:broken] + alone[broken + 1 :]
