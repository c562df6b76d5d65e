"""The harness between a policy's answers and the robot."""

import gc
from collections.abc import Callable, Iterator, Sequence
from itertools import islice

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.doubles import Idle
from vlafuzz.errors import PolicyError
from vlafuzz.policies.base import ActionChunk, ActionSpec, EpisodeStart, Observation, PolicySpec
from vlafuzz.policies.controls import Random
from vlafuzz.policies.harness import GripperCommand, Harness, ask

START = EpisodeStart("one", "pick up apple", "pick-up", 7)
SEEN = Observation("one", 0, "pick up apple")


class Dictated(Idle):
    """Answers with prescribed chunks, repeating the last one; raises exceptions. ``over``: ended rollouts."""

    def __init__(self, *answers: object, execute: int | None = 1, **action: object) -> None:
        self.spec = PolicySpec("dictated", action=ActionSpec(**action), execute=execute)
        self._answers, self.started, self.over, self.calls = answers, [], [], 0

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        self.started += episodes

    def act(self, observations: Sequence[Observation]) -> object:
        answer = self._answers[min(self.calls, len(self._answers) - 1)]
        self.calls += 1
        if isinstance(answer, BaseException):
            raise answer
        return answer

    def finish(self, episodes: Sequence[EpisodeStart]) -> None:
        self.over += episodes


def numbered(*values: float) -> list[ActionChunk]:
    """A chunk whose actions differ in their dx."""
    return [ActionChunk(np.array([[value, 0, 0, 0, 0, 0, 1] for value in values]))]


def chunk_of(*action: float) -> list[ActionChunk]:
    return [ActionChunk(np.array([action], dtype=np.float64))]


def actions_of(policy: Dictated, observe: Callable[[], Observation] = lambda: SEEN) -> Iterator[np.ndarray]:
    """The actions of a rollout; the policy is asked where its last answer is used up."""
    harness = Harness(policy, START)
    while True:
        yield from harness.actions(ask(policy, observe()))


def first(policy: Dictated) -> np.ndarray:
    return next(actions_of(policy))


def gripper_of(values: Sequence[float], **spec: object) -> list[float]:
    gripper = GripperCommand(ActionSpec(**spec))
    return [gripper.command(value) for value in values]


def test_a_rollout_begins_with_a_reset_and_ends_once_when_it_is_told_so():
    policy = Dictated(numbered(0))
    harness = Harness(policy, START)
    assert (policy.started, policy.over) == ([START], [])
    harness.finish()
    harness.finish()
    del harness
    assert policy.over == [START]


def test_a_rollout_ends_when_nobody_holds_it_any_more_even_by_an_error():
    policy = Dictated()  # has no answer: an error
    with pytest.raises(PolicyError):
        first(policy)
    gc.collect()
    assert policy.over == [START]


def test_a_policy_that_does_not_want_to_know_of_the_end_is_not_told():
    Harness(Random(), START).finish()


@pytest.mark.parametrize(
    ("execute", "moves", "calls"),
    [
        (1, [1, 4, 7, 7, 7], 5),
        (2, [1, 2, 4, 5, 7], 3),
        (3, [1, 2, 3, 4, 5], 2),
        (None, [1, 2, 3, 4, 5], 2),
        (9, [1, 2, 3, 4, 5], 2),
    ],
)
def test_so_many_actions_of_a_chunk_are_executed_before_anything_is_observed_again(execute, moves, calls):
    observed = []
    policy = Dictated(numbered(1, 2, 3), numbered(4, 5, 6), numbered(7, 8, 9), execute=execute)
    taken = islice(actions_of(policy, lambda: observed.append(1) or SEEN), len(moves))
    assert [action[0] for action in taken] == moves
    assert policy.calls == len(observed) == calls


def test_scales_turn_units_into_metres_and_radians():
    move = (1, -1, 0.5, 1, -1, 0.5, 1)
    assert first(Dictated(chunk_of(*move))).tolist() == list(move)
    action = first(Dictated(chunk_of(*move), position_scale=0.05, rotation_scale=0.25))
    assert action == pytest.approx([0.05, -0.05, 0.025, 0.25, -0.25, 0.125, 1])


@pytest.mark.parametrize(("rotation", "order"), [("euler_xyz", "xyz"), ("rpy", "zyx")])
def test_angles_are_scaled_first_and_become_a_rotation_vector(rotation, order):
    """Intrinsic ones turn about moving axes, roll, pitch and yaw about fixed ones."""
    action = first(Dictated(chunk_of(0, 0, 0, 1, 2, -1, 1), rotation=rotation, rotation_scale=0.5))
    turns = {axis: Rotation.from_euler(axis, angle) for axis, angle in zip("xyz", (0.5, 1, -0.5), strict=True)}
    one, two, three = (turns[axis] for axis in order)
    assert action[3:6] == pytest.approx((one * two * three).as_rotvec())


@pytest.mark.parametrize(
    ("convention", "values"),
    [
        ("open_positive", [1, 0.1, -0.1, -1]),
        ("close_positive", [-1, -0.1, 0.1, 1]),
        ("open_01", [1, 0.6, 0.4, 0]),
        ("close_01", [0, 0.4, 0.6, 1]),
    ],
)
def test_every_gripper_convention_opens_and_closes(convention, values):
    assert gripper_of(values, gripper=convention) == [1, 1, -1, -1]


@pytest.mark.parametrize(
    ("sticky", "values", "commands"),
    [
        (2, [1, -1, 1, 1, 1, 1], [1, -1, -1, -1, 1, 1]),
        (0, [1, -1, 1, -1, 1, 1], [1, -1, 1, -1, 1, 1]),
        (1, [-1, -1, 1, -1, -1], [-1, -1, 1, 1, -1]),
    ],
)
def test_a_sticky_gripper_keeps_a_change_for_so_many_steps(sticky, values, commands):
    assert gripper_of(values, sticky=sticky) == commands


def test_the_harness_sticks_over_the_border_of_a_chunk():
    close, open_ = [0.0] * 6 + [-1], [0.0] * 6 + [1]
    chunks = [[ActionChunk(np.array([open_, close]))], [ActionChunk(np.array([open_, open_]))]]
    taken = islice(actions_of(Dictated(*chunks, execute=None, sticky=1)), 4)
    assert [action[6] for action in taken] == [1, -1, -1, 1]


@pytest.mark.parametrize(
    ("answer", "cause", "says"),
    [
        (chunk_of(np.nan, 0, 0, 0, 0, 0, 1), "bad_action", "an action is not finite: \\[nan"),
        (numbered(1, 2, np.inf), "bad_action", "an action is not finite"),  # late in a chunk
        (chunk_of(1e300, 0, 0, 0, 0, 0, 1), "bad_action", "an action is beyond 32-bit floats: \\[1.e"),
        ([ActionChunk(np.full((1, 7), 1 + 1j))], "bad_action", "actions are complex128, not real numbers"),
        ([ActionChunk(np.array([["0.1"] * 7]))], "bad_action", "actions are str96, not real numbers"),
        (chunk_of(0, 0, 0, 0, 0, 1), "bad_action", r"actions of shape \(1, 6\)"),
        ([ActionChunk(np.zeros((0, 7)))], "bad_action", r"actions of shape \(0, 7\)"),
        ([ActionChunk(np.zeros(7))], "bad_action", r"actions of shape \(7,\)"),
        ([], "bad_action", "1 observations, 0 chunks"),
        (numbered(1) * 2, "bad_action", "1 observations, 2 chunks"),
        (None, "remote", "raised TypeError"),
        (SystemExit(0), "remote", "dictated raised SystemExit: 0"),
        (ZeroDivisionError("by zero"), "remote", "dictated raised ZeroDivisionError: by zero"),
        (PolicyError("gone", cause="connect"), "connect", "gone"),
    ],
)
def test_an_answer_that_is_no_chunk_is_the_policies_error_with_its_cause(answer, cause, says):
    with pytest.raises(PolicyError, match=says) as caught:
        first(Dictated(answer))
    assert caught.value.cause == cause


def test_an_action_that_its_scale_makes_infinite_is_the_policies_error():
    with pytest.raises(PolicyError, match="beyond 32-bit floats"):
        first(Dictated(chunk_of(1e200, 0, 0, 0, 0, 0, 1), position_scale=1e200))


def test_a_reset_that_raises_is_the_policies_error_too():
    policy = Dictated(numbered(0))
    policy.reset = lambda _: 1 / 0
    with pytest.raises(PolicyError, match="dictated raised ZeroDivisionError"):
        Harness(policy, START)
