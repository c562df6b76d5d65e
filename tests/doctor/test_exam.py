"""The doctor's verdicts in the simulator on policies with one planted fault each, and on healthy ones."""

import re
import time
from collections.abc import Callable, Sequence
from contextlib import closing

import numpy as np
import pytest

from tests.doctor.faults import FAULTS, Changed
from vlafuzz.campaign.config import RunConfig, plan
from vlafuzz.common.check import Check
from vlafuzz.common.watch import SILENT, Watch
from vlafuzz.doctor.exam import Exam
from vlafuzz.policies.base import ActionChunk, Observation, Policy
from vlafuzz.rollouts.policies import make_policy

Examine = Callable[..., list[Check]]


@pytest.fixture(scope="module")
def examine() -> Examine:
    """``examine(policy, n, task)``: all checks with ``n`` nominal rollouts, or only the quick ones."""

    def checks(policy: Policy, n: int = 0, task: str = "pick-up", watch: Watch = SILENT) -> list[Check]:
        manifest = plan(RunConfig(task=task, policy="pinhole"), policy=policy).manifest
        with closing(Exam(manifest, policy, watch)) as exam:
            return list(exam.thorough(n) if n else exam.quick())

    return checks


def named(checks: list[Check]) -> dict[str, str]:
    """The verdict of every check that is not ok, and what follows up to the colon."""
    bad = (check for check in checks if check.verdict != "ok")
    return {check.check: f"{check.verdict} {check.follows.partition(':')[0]}" for check in bad}


class Drowsy(Changed):
    """Pinhole that takes 20 ms for an answer, and 10 ms more for each further one of a batch."""

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        time.sleep(0.02 + 0.01 * (len(observations) - 1))
        return super().act(observations)


def test_the_time_of_an_answer_is_measured_alone_and_in_batches():
    policy = Drowsy("pinhole", max_batch=8)
    policy.answers_batches = True  # as of a server
    planned = plan(RunConfig(policy="pinhole", strategy="random"), policy=policy)
    with closing(Exam(planned.manifest, policy)) as exam:
        assert list(exam.quick())
        alone, eight = exam.speed(), exam.speed(planned)
    assert 0.02 <= alone.step < 0.2
    assert 0.09 / 8 <= eight.step < alone.step
    assert eight.words.startswith("measured: an answer takes 0.")
    assert ", 8 at once 0." in eight.words


# The checks that must not be ok, by fault.
QUICK = {
    "blind": {"sight": "refuse blind"},
    "deaf": {"hearing": "warn deaf"},
    "constant": {"actions": "refuse constant"},
    "NaN": {"actions": "refuse answer with finite numbers, (steps, 7)"},
    "saturated": {"actions": "refuse saturated"},
    "nondeterministic": {"determinism": "warn not deterministic"},
    "refusing": {"connects": "refuse it refused"},
    "dropping": {"rollouts": "refuse it broke off"},
}
THOROUGH = {
    "batch order mixed": {"batch": "refuse mixed up"},
    "slow": {"speed": "warn slow"},
    "x and y swapped": {"nominal": "refuse it cannot do the task", "wiring": "refuse miswired"},
    "gripper inverted": {"nominal": "refuse it cannot do the task", "wiring": "refuse miswired"},
    "wrong scale": {"nominal": "refuse it cannot do the task", "wiring": "refuse miswired"},
}
SEEING = ("BGR", "upside down")  # faults of pictures
DETAILS = {
    "x and y swapped": "x and y of its moves are swapped",
    "gripper inverted": "its gripper opens where it should close",
    "wrong scale": "its moves have the wrong length",
    "chunk offset": "its chunks begin 1 step too early",
    "BGR": "it gets red and blue exchanged",
    "upside down": "it gets its pictures upside down",
}


@pytest.mark.parametrize("fault", QUICK)
def test_the_fault_of_a_policy_is_named_in_seconds(examine: Examine, fault: str):
    assert named(examine(FAULTS[fault]("pinhole"))) == QUICK[fault]


def test_several_answers_in_the_wrong_order_are_named(examine: Examine):
    assert named(examine(FAULTS["batch order mixed"]("pinhole"), 1)) == THOROUGH["batch order mixed"]


def test_swapped_axes_are_named_and_every_rollout_is_told_without_the_rest_of_nominal_scenes_that_fail(examine):
    told: list[str] = []

    class Told(Watch):
        def progress(self, description: str, done: int, total: int | None) -> None:
            told.append(f"{description}: {done} of {total}")

    checks = examine(FAULTS["x and y swapped"]("pinhole"), 4, watch=Told())
    assert named(checks) == THOROUGH["x and y swapped"]
    assert checks[-1].found.startswith(DETAILS["x and y swapped"])
    assert "3 rollouts completed" in [check.found for check in checks]
    nominal = [line for line in told if line.startswith("nominal")]
    assert nominal == [f"nominal rollouts: {done} of 4" for done in range(4)]
    assert any(re.fullmatch(r"rollouts with corrections: 1 of 1\d\d", line) for line in told)


@pytest.mark.parametrize("name", ["pinhole", "expert"])
def test_a_healthy_policy_that_sees_no_picture_gets_no_warning(examine: Examine, name: str):
    checks = examine(make_policy(name), 3)
    assert named(checks) == {}
    assert checks[-1].check == "wiring"


def noisy(healthy: Policy) -> Policy:
    rng = np.random.default_rng(0)
    noise = np.array([0.01, 0.01, 0.01, 0.05, 0.05, 0.05, 0])
    return Changed(healthy, answer=lambda actions: actions + rng.normal(size=(1, 7)) * noise, deterministic=False)


def test_a_stochastic_policy_that_says_so_is_healthy(examine: Examine):
    assert named(examine(noisy(make_policy("pinhole")))) == {}


def test_noise_does_not_hide_that_a_policy_is_blind(examine: Examine):
    assert named(examine(noisy(FAULTS["blind"]("pinhole")))) == QUICK["blind"]


@pytest.mark.slow
@pytest.mark.parametrize("fault", THOROUGH)
def test_the_fault_of_a_policy_is_named_after_rollouts(examine: Examine, fault: str):
    checks = examine(FAULTS[fault]("pinhole"), 6)
    assert named(checks) == THOROUGH[fault]
    assert checks[-1].found.startswith(DETAILS.get(fault, ""))


@pytest.mark.slow
@pytest.mark.render
@pytest.mark.parametrize("fault", [*QUICK, *THOROUGH, "chunk offset", *SEEING])
def test_the_fault_of_a_learned_policy_is_named(examine: Examine, fault: str):
    checks = examine(FAULTS[fault]("mini"), 10)
    expected = {"wiring": "refuse miswired"} if fault in DETAILS else (QUICK | THOROUGH)[fault]
    assert named(checks).items() >= expected.items()  # more, where it cannot do the task for it
    assert checks[-1].found.startswith(DETAILS.get(fault, ""))


@pytest.mark.slow
@pytest.mark.render
@pytest.mark.parametrize("task", ["pick-up", "move-near", "put-on", "put-in"])
@pytest.mark.parametrize("name", ["mini", "pinhole"])
def test_a_healthy_policy_gets_no_warning_in_any_task(examine: Examine, name: str, task: str):
    assert named(examine(make_policy(name), 8, task)) == {}
