"""What every evaluator keeps: one outcome a scene, in order, and nothing raised for what a scene does."""

from collections.abc import Callable
from dataclasses import replace

import pytest

from tests.doubles import ClosedForm, scene
from tests.worlds.tabletop.sim.scenes import evaluator_of
from vlafuzz.model import Placement, Verdict
from vlafuzz.policies.controls import Random
from vlafuzz.worlds.evaluator import Evaluator

MAKERS: dict[str, Callable[[], Evaluator]] = {"closed form": ClosedForm, "maniskill": lambda: evaluator_of(Random())}
FAIR, ANOTHER, FAR = scene(light=0.25), scene(light=0.25, y=0.1), scene(x=1.0)


@pytest.fixture(scope="module", params=MAKERS.values(), ids=MAKERS)
def evaluator(request) -> Evaluator:
    made = request.param()
    yield made
    made.close()


def test_no_scenes_no_outcomes(evaluator: Evaluator):
    assert evaluator.evaluate([]) == []


def test_there_is_one_outcome_a_scene_in_their_order(evaluator: Evaluator):
    verdicts = [outcome.verdict for outcome in evaluator.evaluate([FAR, FAIR, FAR])]
    assert verdicts == [Verdict.INVALID, Verdict.FAILED, Verdict.INVALID]


def test_equal_scenes_have_equal_outcomes_whatever_lies_between(evaluator: Evaluator):
    first, _, _, again = evaluator.evaluate([FAIR, ANOTHER, FAR, replace(FAIR)])
    assert (first.verdict, first.progress, first.lost_stage) == (again.verdict, again.progress, again.lost_stage)
    hashes = [[rollout.states_hash for rollout in outcome.rollouts] for outcome in (first, again)]
    assert hashes[0] == hashes[1]


def test_progress_and_verdict_agree(evaluator: Evaluator):
    for outcome in evaluator.evaluate([FAIR, ANOTHER, FAR]):
        assert 0 <= outcome.progress <= 1
        assert (outcome.lost_stage is None) == (outcome.verdict is not Verdict.FAILED)
        assert bool(outcome.rollouts) == (outcome.verdict in (Verdict.PASSED, Verdict.FAILED))
        assert bool(outcome.detail) == (outcome.verdict is Verdict.INVALID)


@pytest.mark.parametrize(
    "target", [Placement("no such thing", "flat", 2.0, 0.0), Placement("green_cube", "upside down", 2.0, 0.0)]
)
def test_a_scene_that_cannot_be_built_is_an_outcome_too(evaluator: Evaluator, target: Placement):
    outcomes = evaluator.evaluate([replace(FAIR, targets=(target,)), FAIR])
    assert [outcome.verdict for outcome in outcomes] == [Verdict.INVALID, Verdict.FAILED]
