"""Verdicts on given facts."""

from dataclasses import replace

import numpy as np
import pytest

from tests.doubles import failed, passed
from vlafuzz.doctor import verdicts
from vlafuzz.doctor.probes import Answers, Break, Effect
from vlafuzz.errors import PolicyError
from vlafuzz.model import Outcome
from vlafuzz.policies.base import CameraRequest, PolicySpec

CAMERA = CameraRequest("front", 128, 128)
SEEING = PolicySpec("seeing", cameras=(CAMERA,), state=True)
RNG = np.random.default_rng(0)
GONE = Break("after 5 answers", PolicyError("gone", cause="connect"))
WALK = np.hstack([RNG.normal(0, 0.02, (20, 6)), np.ones((20, 1))])


def test_what_nobody_declares_is_a_guess_that_the_user_can_settle():
    guessed = {"server": "Pi0", "rotation": "default", "gripper": "default", "state": "none"}
    check = verdicts.on_spec(replace(SEEING, provenance=guessed), hz=5)
    assert check.verdict == "warn"
    assert check.follows == "guessed: say rotation=… and gripper=… in the policy's name"


def test_a_whole_spec_is_fine():
    assert verdicts.on_spec(SEEING, hz=25) == ("spec", "sees front, proprioception, 25 Hz", "ok", "")


@pytest.mark.parametrize(
    ("executed", "verdict", "says"),
    [
        (WALK, "ok", ""),
        (WALK * 0 + 0.01, "refuse", "constant"),
        (np.sign(WALK) * 0.05, "refuse", "saturated"),
        (np.clip(WALK * 50, -0.05, 0.05), "refuse", "saturated"),
        (WALK * 30, "warn", "out of range"),
        (WALK * [0.001, 0.001, 0.001, 0.001, 0.001, 0.001, 1], "warn", "out of range"),
        (WALK * [1, 0, 0, 0, 0, 0, 1], "ok", ""),
        (np.array([[0, 0, -0.03, 0, 0, 0, 1]] * 9 + [[0, 0, 0, 0, 0, 0, -1]]), "ok", ""),
    ],
)
def test_actions_are_to_differ_within_the_range_of_an_arm(executed: np.ndarray, verdict: str, says: str):
    check = verdicts.on_actions(SEEING, 5, executed)
    assert (check.verdict, check.follows.partition(":")[0]) == (verdict, says)


@pytest.mark.parametrize(
    ("black", "elsewhere", "verdict"),
    [(0.9, 0.8, "ok"), (0.9, 0.0, "warn"), (0.0, 0.0, "refuse"), (0.01, 0.01, "refuse")],
)
def test_who_notices_the_dark_but_no_other_scene_is_nearly_blind(black: float, elsewhere: float, verdict: str):
    changes = {name: Effect(size, size > 0.02) for name, size in (("black", black), ("another", elsewhere))}
    assert verdicts.on_sight(changes).verdict == verdict


def answers(spec: PolicySpec = SEEING, noise: float = 0.0) -> tuple[Answers, list[np.ndarray]]:
    """The answers to six moments, and the same without noise."""
    once = [np.full((1, 7), 0.01 * number) for number in range(6)]
    return Answers(spec, once, [answer + noise for answer in once]), once


def test_who_says_deterministic_has_to_be():
    assert verdicts.on_determinism(SEEING, answers()[0]).verdict == "ok"
    assert verdicts.on_determinism(SEEING, answers(noise=0.001)[0]).verdict == "warn"
    stochastic = replace(SEEING, deterministic=False)
    assert verdicts.on_determinism(stochastic, answers(noise=0.001)[0]).verdict == "ok"


def test_last_digits_that_depend_on_the_company_are_a_warning_and_an_exchange_is_refused():
    known, once = answers()
    assert verdicts.on_batch(SEEING, known, once).verdict == "ok"
    assert verdicts.on_batch(SEEING, known, [answer + 1e-7 for answer in once]).verdict == "warn"
    crossed = verdicts.on_batch(SEEING, known, once[::-1])
    assert (crossed.verdict, crossed.follows.partition(":")[0]) == ("refuse", "mixed up")
    alike = verdicts.on_batch(SEEING, known, [once[0]] * 6)
    assert alike.verdict == "refuse"


def test_an_answer_may_take_as_long_as_its_actions_last():
    assert verdicts.on_speed(5, [9.0, 0.3, 0.3], steps=2).verdict == "ok"
    slow = verdicts.on_speed(5, [9.0, 0.5, 0.5], steps=2)
    assert (slow.verdict, slow.found) == ("warn", "an answer takes 0.5 s, and lasts for 0.4 s at 5 Hz")


@pytest.mark.parametrize(("solved", "verdict"), [(10, "ok"), (5, "ok"), (4, "warn"), (0, "refuse")])
def test_who_solves_no_nominal_scene_says_nothing_about_others(solved: int, verdict: str):
    check = verdicts.on_nominal([passed()] * solved + [failed(0.3)] * (10 - solved))
    assert check.verdict == verdict
    assert check.found.startswith(f"succeeds in {solved} of 10 nominal scenes, 95 % interval ")


@pytest.mark.parametrize(
    ("broken", "breaks", "verdict", "says"),
    [
        (0, 0, "ok", "8 rollouts completed"),
        (0, 1, "warn", "8 rollouts completed, 1 restarted"),
        (1, 1, "warn", "1 of 9 rollouts broke: broke after 5 answers: gone"),
        (2, 1, "refuse", "2 of 10 rollouts broke: broke after 5 answers: gone"),
    ],
)
def test_a_rollout_may_break_once(broken: int, breaks: int, verdict: str, says: str):
    outcomes = [passed()] * 8 + [Outcome.error("policy: connect: gone")] * broken
    check = verdicts.on_rollouts(outcomes, [GONE] * breaks)
    assert (check.verdict, check.found) == (verdict, says)
    assert verdicts.on_nominal(outcomes).found.startswith("succeeds in 8 of 8 ")


def test_a_simulator_that_breaks_is_told_apart_from_the_policy():
    check = verdicts.on_rollouts([passed(), Outcome.error("simulator: OSError: no space")], [])
    assert check.found == "1 of 2 rollouts broke: simulator: OSError: no space"
    assert check.follows == "`vlafuzz doctor` checks this machine"
