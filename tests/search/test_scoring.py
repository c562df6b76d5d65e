from dataclasses import replace

import numpy as np
import pytest

from tests.doubles import STAGES, TinySpace, failed, passed, rollout, scene
from vlafuzz.model import Outcome, Verdict
from vlafuzz.search.scoring import score
from vlafuzz.worlds.manipulation.rigs import Workspace
from vlafuzz.worlds.tabletop.objects import load_catalogue
from vlafuzz.worlds.tabletop.space import SearchSpace, load_operators

SPACE = TinySpace()
TABLE = SearchSpace(load_operators(), load_catalogue(), "pick-up")
TABLE.rig = replace(TABLE.rig, workspace=Workspace(x=(-0.2, 0.2), y=(-0.4, 0.4)))


def test_a_failure_scores_its_progress_and_severity():
    got = score(scene(light=16.0), failed(progress=0.25), SPACE)
    assert (got.verdict, got.progress, got.severity, got.failed) == (Verdict.FAILED, 0.25, 1.0, True)


@pytest.mark.parametrize("outcome", [Outcome.invalid("solved", "already solved"), Outcome.error("timeout")])
def test_progress_is_unknown_where_the_policy_was_not_judged(outcome: Outcome):
    got = score(scene(), outcome, SPACE)
    assert (got.progress, got.rolled_out) == (None, False)


def test_progress_that_is_not_a_number_is_unknown():
    assert score(scene(), Outcome(verdict=Verdict.FAILED, progress=float("nan")), SPACE).progress is None


def passed_after(*steps: int) -> Outcome:
    """Success at those control steps, counted from 0, one rollout each."""
    traces = [np.repeat(np.float32([0.5, 1.0]), [step, 10]) for step in steps]
    return Outcome.of(tuple(replace(rollout(), trace=trace) for trace in traces), STAGES)


def test_the_slack_of_a_pass_is_the_less_the_later_its_slowest_rollout_succeeded():
    slacks = [score(scene(), passed_after(*steps), SPACE).slack for steps in ((0,), (1,), (9,), (3, 0))]
    assert slacks == [1.0, 0.5, 0.1, 0.25]


def test_failures_have_no_slack_and_passes_no_cell():
    lost, done = (score(scene(x=0.0), outcome, SPACE) for outcome in (failed(), passed()))
    assert (lost.slack, lost.cell) == (0.0, "grasp|base")
    assert (done.slack > 0, done.cell) == (True, None)


def test_early_failures_are_harder_than_late_ones_those_than_passes_and_soon_passes_are_the_easiest():
    outcomes = [failed(0.1), failed(0.9), passed_after(60), passed_after(10), Outcome.error("timeout")]
    eases = [score(scene(), outcome, SPACE).ease for outcome in outcomes]
    assert eases == sorted(set(eases))
    assert eases[-1] == float("inf")


def test_a_pass_without_a_trace_is_as_hard_as_can_be():
    assert score(scene(), Outcome(verdict=Verdict.PASSED, progress=1.0), SPACE).ease == 1.0


def test_a_site_names_far_operators_and_place():
    severities = {"light": 0.9, "camera-position": 0.6, "target-type": 0.5}
    assert TABLE.site(scene(x=0.0, y=-0.39), severities) == "camera-position+light|x2y0"


@pytest.mark.parametrize(("x", "y", "place"), [(-0.2, -0.4, "x0y0"), (0.2, 0.4, "x3y3"), (-9.0, 9.0, "x0y3")])
def test_the_workspace_is_a_grid_of_four_by_four_and_its_rim_belongs_to_it(x: float, y: float, place: str):
    assert TABLE.site(scene(x=x, y=y), {}).endswith(place)


def test_a_site_does_not_depend_on_small_differences():
    first, second = scene(x=0.01, y=0.01), replace(scene(x=0.02, y=0.05), instruction="take the cube")
    assert TABLE.site(first, {"light": 0.7}) == TABLE.site(second, {"light": 0.8})
