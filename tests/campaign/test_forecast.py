"""How long a run will take: from the seconds of an answer, and how many rollouts there are at a time."""

from dataclasses import replace
from pathlib import Path

import pytest

from vlafuzz.campaign.config import Plan, RunConfig, plan
from vlafuzz.campaign.forecast import Forecast, Speed, answered_together, at_a_time, usual_speed
from vlafuzz.common.deadline import Deadline
from vlafuzz.policies.controls import Random
from vlafuzz.rollouts.registry import Place

SLOW = Speed(0.5, "measured: an answer takes 0.5 s")


class Common(Random):
    answers_batches = True

    def __init__(self) -> None:
        super().__init__()
        self.spec = replace(self.spec, max_batch=8)


@pytest.fixture
def planned(tmp_path: Path) -> Plan:
    """300 rollouts of up to 80 steps."""
    return plan(RunConfig(policy="random", budget=300, workers=1, store=tmp_path / "a.db"))


def test_rollouts_one_at_a_time_take_an_answer_a_step(planned: Plan):
    forecast = Forecast(planned, SLOW, certify=False)
    assert forecast.run == pytest.approx(300 * 0.7 * 80 * 0.5)
    says = "about 2.3 h: 300 rollouts of up to 80 steps take 70 min to 3.3 h; measured: an answer takes 0.5 s"
    assert str(forecast) == says


def test_a_run_has_as_many_rollouts_at_a_time_as_workers_or_as_its_server_takes(planned: Plan):
    assert at_a_time(replace(planned, place=Place(workers=2))) == 2
    eight = replace(planned, manifest=replace(planned.manifest, batch=8), policy=Common())
    assert (at_a_time(eight), answered_together(eight), answered_together(planned)) == (8, True, False)


def test_more_workers_certify_in_less_time(planned: Plan):
    two = replace(planned, triage_place=Place(workers=2))
    assert Forecast(two, SLOW, certify=True).of_cause == Forecast(planned, SLOW, certify=True).of_cause / 2


def test_certification_is_a_part_of_it(planned: Plan):
    forecast = Forecast(planned, SLOW, certify=True)
    assert forecast.certification == pytest.approx(6 * 50 * 0.7 * 80 * 0.5)
    assert "certifying their causes about 2.3 h" in str(forecast)


def test_built_in_policies_have_a_usual_speed_and_others_are_measured(planned: Plan):
    speed = usual_speed(planned)
    assert speed is not None
    assert speed.words == "at the usual speed of random"
    own = replace(planned, manifest=replace(planned.manifest, policy="python:my:make"))
    assert usual_speed(own) is None


def within(planned: Plan, minutes: float, *, certify: bool) -> Forecast:
    """A forecast with ``--time``; half of it is for the run where certification follows."""
    until = Deadline(60 * minutes + 1)
    return Forecast(planned, SLOW, certify, until.after(0.5) if certify else until, until)


def test_with_a_time_it_says_when_that_ends_it(planned: Plan):
    assert str(within(planned, 30, certify=False)) == (
        "about 2.3 h: 300 rollouts of up to 80 steps take 70 min to 3.3 h; --time ends it after 30 min; "
        "measured: an answer takes 0.5 s"
    )


def test_with_a_time_it_says_whether_certification_fits(planned: Plan):
    hopeless, fits = within(planned, 30, certify=True), within(planned, 240, certify=True)
    assert "; --time ends it after 30 min, probably before a cause is certified; " in str(hopeless)
    assert (hopeless.too_short, fits.too_short) == (True, False)
    assert "certifying their causes about 2.3 h; --time ends it after 4.0 h; measured" in str(fits)


def test_a_time_that_is_long_enough_changes_nothing(planned: Plan):
    assert str(within(planned, 6000, certify=True)) == str(Forecast(planned, SLOW, certify=True))
