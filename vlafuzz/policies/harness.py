"""The harness between policy and robot: action queue, unit conversion, sticky gripper, checks of answers."""

import sys
import weakref
from collections.abc import Iterable, Sequence
from math import hypot

import numpy as np

from vlafuzz.common.arrays import Array
from vlafuzz.errors import PolicyError
from vlafuzz.policies.base import ActionChunk, ActionSpec, EpisodeStart, Finishing, Observation, Policy

WIDTH = ActionSpec().width
_NOT_REAL = "cSUmM"  # kinds of dtypes that NumPy would convert all the same
_LARGEST = float(np.finfo(np.float32).max)  # as which actions are stored
_AXES = {"euler_xyz": "XYZ", "rpy": "xyz"}  # in SciPy, capital letters mean intrinsic rotations


class Harness:
    """One rollout of a policy: converts its chunks of actions to metric actions.

    ``finish()`` ends the rollout; so does the garbage collection of this object.
    """

    def __init__(self, policy: Policy, start: EpisodeStart) -> None:
        self._spec = policy.spec
        self._gripper = GripperCommand(self._spec.action)
        with BlamedOn(self._spec.name):
            policy.reset([start])
        self.finish = weakref.finalize(self, finish, policy, [start])

    def actions(self, chunk: ActionChunk) -> Iterable[Array]:
        """The actions to execute of an answer that ``ask`` or ``BatchingPolicy`` has checked, each when it is its turn.

        They are ``(7,)`` metres, radians, -1 or 1 for the gripper; of another width as they are.
        """
        executed = chunk.actions[: self._spec.execute]
        each = map(executed.__getitem__, range(len(executed)))  # NumPy's own iteration ends with an exception
        return map(self._metric, each) if self._spec.action.width == WIDTH else each

    def _metric(self, action: Array) -> Array:
        spec = self._spec.action
        with np.errstate(over="ignore"):
            _check_finite((action * _units(spec))[None], self._spec.name)
        move = metric(action, spec)
        move[6] = self._gripper.command(float(action[6]))
        return move


def metric(action: Array, spec: ActionSpec) -> Array:
    """``(7,)`` in the units of the spec to metres and a rotation vector in radians; the gripper stays as it is."""
    move = action * _units(spec)
    if spec.rotation in _AXES:
        from scipy.spatial.transform import Rotation  # a catalogue is loaded without it

        move[3:6] = Rotation.from_euler(_AXES[spec.rotation], move[3:6]).as_rotvec()
    return move


def written_as(move: Array, spec: ActionSpec) -> Array:
    """The inverse of ``metric``."""
    action = move.copy()
    if spec.rotation in _AXES:
        from scipy.spatial.transform import Rotation

        action[3:6] = Rotation.from_rotvec(move[3:6]).as_euler(_AXES[spec.rotation])
    return action / _units(spec)


def _units(spec: ActionSpec) -> Array:
    return np.array([spec.position_scale] * 3 + [spec.rotation_scale] * 3 + [1.0])


def ask(policy: Policy, observation: Observation) -> ActionChunk:
    """The policy's answer to one observation; a PolicyError if it raised, or that is no chunk of finite actions."""
    spec = policy.spec
    with BlamedOn(spec.name):
        return check_chunks(policy.act([observation]), 1, spec.name, spec.action.width)[0]


class PartlyAnsweredError(PolicyError):
    """Some of several observations have an answer, and the policy has advanced their rollouts.

    ``answers``: one per observation, in the same order; an error where there is none.
    """

    def __init__(self, answers: Sequence[ActionChunk | PolicyError]) -> None:
        first = next(answer for answer in answers if isinstance(answer, PolicyError))
        super().__init__(first.message, first.hint, first.cause)
        self.answers = answers

    def __reduce__(self) -> tuple[object, ...]:
        return (type(self), (self.answers,))


def answered(answers: Sequence[ActionChunk | PolicyError]) -> list[ActionChunk]:
    """The answers, if no error is among them: a single one is raised, of several answers a PartlyAnsweredError."""
    chunks = [answer for answer in answers if isinstance(answer, ActionChunk)]
    if len(chunks) == len(answers):
        return chunks
    raise answers[0] if len(answers) == 1 and isinstance(answers[0], PolicyError) else PartlyAnsweredError(answers)


def finish(policy: Policy, episodes: Sequence[EpisodeStart]) -> None:
    """End these rollouts, where the policy keeps resources for each."""
    if episodes and isinstance(policy, Finishing):
        policy.finish(episodes)


class BlamedOn:
    """Converts every exception in a block to a PolicyError of the policy of this name."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __enter__(self) -> None: ...

    def __exit__(self, _: object, error: BaseException | None, where: object) -> None:
        if isinstance(error, Exception | SystemExit) and not isinstance(error, PolicyError):
            raise PolicyError(f"{self._name} raised {type(error).__name__}: {error}") from error


def release(policy: Policy) -> None:
    """Close a policy. One that cannot be closed costs no result; its error is a note on stderr."""
    try:
        policy.close()
    except (Exception, SystemExit) as error:
        sys.stderr.write(f"note: {policy.spec.name} raised {type(error).__name__} in close: {error}\n")


class GripperCommand:
    """Thresholds a policy's gripper value to open (1) or closed (-1); holds a change for ``sticky`` steps."""

    def __init__(self, spec: ActionSpec) -> None:
        self._convention, self._sticky = spec.gripper, spec.sticky
        self._now, self._kept = 1.0, 0

    def command(self, value: float) -> float:
        threshold = 0.5 if self._convention.endswith("01") else 0.0
        wanted = 1.0 if (value > threshold) == self._convention.startswith("open") else -1.0
        if self._kept > 0:
            self._kept -= 1
        elif wanted != self._now:
            self._now, self._kept = wanted, self._sticky
        return self._now


def check_chunks(chunks: Sequence[ActionChunk], expected: int, name: str, width: int = WIDTH) -> list[ActionChunk]:
    """The chunks with actions as floats, ``(steps, width)``; PolicyError for a wrong number, shape or value."""
    if len(chunks) != expected:
        message = f"{name}: {expected} observations, {len(chunks)} chunks of actions"
        raise PolicyError(message, "answer every observation with one chunk", "bad_action")
    checked: list[ActionChunk] = []  # list[ActionChunk]() takes as long as the rest, and this is called at each step
    for chunk in chunks:
        given = np.asarray(getattr(chunk, "actions", chunk))
        if given.dtype.kind in _NOT_REAL:
            raise PolicyError(f"{name}: actions are {given.dtype.name}, not real numbers", cause="bad_action")
        actions, shape = given.astype(np.float64), given.shape  # a copy, since a policy may use its array again
        if len(shape) != 2 or shape[1] != width or shape[0] == 0:
            message = f"{name}: actions of shape {shape}"
            raise PolicyError(message, f"expected (steps, {width}), at least one step", "bad_action")
        if not hypot(*actions.ravel().tolist()) <= _LARGEST:  # a quick look, since each step counts
            _check_finite(actions, name)
        checked.append(ActionChunk(actions))
    return checked


def _check_finite(actions: Array, name: str) -> None:
    usable = np.abs(actions) <= _LARGEST
    if not usable.all():
        bad = actions[~usable.all(axis=1)][0]
        problem = "is beyond 32-bit floats" if np.isfinite(bad).all() else "is not finite"
        raise PolicyError(f"{name}: an action {problem}: {bad}", cause="bad_action")
