from dataclasses import replace

import pytest

from tests.doubles import TinySpace, failed, passed, scene
from vlafuzz.outcome import Outcome, Verdict
from vlafuzz.rig import Workspace
from vlafuzz.scoring import cell, score, wilson

SPACE = TinySpace()
TABLE = Workspace(x=(-0.2, 0.2), y=(-0.4, 0.4))


def test_a_failure_scores_its_progress_and_severity():
    got = score(scene(light=16.0), failed(progress=0.25), SPACE)
    assert (got.verdict, got.progress, got.severity, got.failed) == (Verdict.FAILED, 0.25, 1.0, True)


def test_a_pass_is_no_failure():
    assert not score(scene(), passed(), SPACE).failed


@pytest.mark.parametrize("outcome", [Outcome.invalid("solved", "already solved"), Outcome.error("timeout")])
def test_progress_is_unknown_where_the_subject_was_not_judged(outcome: Outcome):
    got = score(scene(), outcome, SPACE)
    assert (got.progress, got.rolled_out) == (None, False)


def test_progress_that_is_not_a_number_is_unknown():
    assert score(scene(), Outcome(Verdict.FAILED, progress=float("nan")), SPACE).progress is None


def test_a_cell_names_lost_stage_far_operators_and_place():
    severities = {"light": 0.9, "camera-position": 0.6, "target-type": 0.5}
    assert cell(scene(x=0.0, y=-0.39), failed(), severities, TABLE) == "grasp|camera-position+light|x2y0"


def test_a_failure_near_nominal_is_in_a_base_cell():
    assert cell(scene(x=0.0, y=0.0), failed(), {"light": 0.1}, TABLE) == "grasp|base|x2y2"


@pytest.mark.parametrize(("x", "y", "place"), [(-0.2, -0.4, "x0y0"), (0.2, 0.4, "x3y3"), (-9.0, 9.0, "x0y3")])
def test_the_workspace_is_a_grid_of_four_by_four_and_its_rim_belongs_to_it(x: float, y: float, place: str):
    assert cell(scene(x=x, y=y), failed(), {}, TABLE).endswith(place)


def test_a_cell_does_not_depend_on_small_differences():
    one, other = scene(x=0.01, y=0.01), replace(scene(x=0.02, y=0.05), instruction="take the cube")
    assert cell(one, failed(0.1), {"light": 0.7}, TABLE) == cell(other, failed(0.2), {"light": 0.8}, TABLE)


def test_wilson_agrees_with_the_published_example():
    low, high = wilson(1, 29)  # Newcombe 1998, Table I: 1 of 29 is 0.0061 to 0.1718
    assert (round(low, 4), round(high, 4)) == (0.0061, 0.1718)


def test_wilson_of_nothing_is_everything():
    assert wilson(0, 0) == (0.0, 1.0)


def test_more_confidence_is_a_wider_interval():
    assert wilson(5, 10, 0.99).low < wilson(5, 10).low < 0.5 < wilson(5, 10).high < wilson(5, 10, 0.99).high
