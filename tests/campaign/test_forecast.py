"""How long a run will take: from the seconds of an answer, and how many rollouts there are at a time."""

from dataclasses import replace
from pathlib import Path

import pytest

from vlafuzz.campaign.config import Plan, RunConfig, plan
from vlafuzz.campaign.forecast import Forecast, Speed, at_a_time, usual_speed
from vlafuzz.common.deadline import Deadline
from vlafuzz.policies.controls import Random
from vlafuzz.rollouts.registry import Place

SLOW = Speed(answer=0.5, simulator=0.0, batch=8, batched=0.8, words="measured: an answer takes 0.5 s")


class Common(Random):
    shared, answers_batches = True, True

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
    assert str(forecast) == (
        "about 2.3 h: 300 rollouts of up to 80 steps take 70 min to 3.3 h; measured: an answer takes 0.5 s"
    )


def test_of_a_long_answer_several_steps_are_executed(planned: Plan):
    forecast = Forecast(planned, replace(SLOW, actions=5), certify=False)
    assert forecast.run == pytest.approx(300 * 0.7 * 80 / 5 * 0.5)


def test_workers_with_a_policy_each_share_the_rollouts(planned: Plan):
    two = replace(planned, place=Place(workers=2))
    assert at_a_time(two) == 2
    assert Forecast(two, SLOW, certify=False).run == pytest.approx(300 * 0.7 * 80 * 0.5 / 2)


def test_workers_that_share_a_policy_are_answered_in_batches(planned: Plan):
    shared = replace(planned.manifest, policy=f"python:{__name__}:Common")
    eight = replace(planned, manifest=shared, place=Place(workers=8))
    assert Forecast(eight, SLOW, certify=False).run == pytest.approx(300 * 0.7 * 80 * 0.8 / 8)


def test_scenes_in_lockstep_are_answered_in_batches_and_share_the_simulator(planned: Plan):
    eight = replace(planned, manifest=replace(planned.manifest, batch=8), policy=Common())
    speed = replace(SLOW, simulator=0.01)
    assert at_a_time(eight) == 8
    assert Forecast(eight, speed, certify=False).run == pytest.approx(300 * 0.7 * 80 * (0.8 / 8 + 0.01))


@pytest.mark.parametrize(("number", "seconds"), [(1, 0.5), (8, 0.8), (9, 1.6), (16, 1.6)])
def test_a_batch_that_is_too_large_is_several(number: int, seconds: float):
    assert SLOW.at_once(number) == pytest.approx(seconds)


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


def within(planned: Plan, minutes: float, *, certify: bool, speed: Speed = SLOW) -> Forecast:
    """A forecast with ``--time``; half of it is for the run where certification follows."""
    until = Deadline(60 * minutes + 1)
    return Forecast(planned, speed, certify, until.after(0.5) if certify else until, until)


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
