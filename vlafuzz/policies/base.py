"""The policy under test as a protocol: what it asks for, what it observes and what it answers."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field
from reprlib import repr as shown
from typing import Any, Literal, Protocol, get_args, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from vlafuzz.common.arrays import Array, Picture
from vlafuzz.errors import UsageError

Role = Literal["third_person", "wrist"]
Rotation = Literal["axis_angle", "euler_xyz", "rpy"]
Relative = Literal["target", "current"]
Gripper = Literal["open_positive", "close_positive", "open_01", "close_01"]
SIM_HZ = 100  # of the simulator
_MOST_PIXELS = 4096  # of a side of an image


def _expect(name: str, value: object, expected: str, usable: object) -> None:
    """Raise a UsageError unless a value is usable."""
    if not usable:
        message = f"the policy's spec: {name}: expected {expected}, got {shown(value)}"
        raise UsageError(message, hint="vlafuzz.policies.base describes ActionSpec and PolicySpec")


def _expect_one_of(name: str, value: object, literal: object) -> None:
    known = get_args(literal)
    _expect(name, value, f"one of {', '.join(known)}", isinstance(value, str) and value in known)


def _expect_count(name: str, value: object, least: int, most: float = math.inf) -> None:
    expected = f"{least} or more" if most == math.inf else f"{least} to {most}"
    _expect(name, value, expected, isinstance(value, int) and least <= value <= most)


@dataclass(frozen=True)
class CameraRequest:
    """An image of ``width`` by ``height`` pixels in every observation; a UsageError for values without sense."""

    name: str
    width: int
    height: int
    role: Role = "third_person"

    def __post_init__(self) -> None:
        _expect("name of a camera", self.name, "a text", isinstance(self.name, str))
        for side in ("width", "height"):
            _expect_count(f"{side} of the camera {self.name}", getattr(self, side), 1, _MOST_PIXELS)
        _expect_one_of("role", self.role, Role)


@dataclass(frozen=True, kw_only=True)
class ActionSpec:
    """What the seven numbers of an action mean. The defaults are those of our metric controller.

    Translation along and rotation about the axes of the robot's base, then the gripper.

    Attributes:
        rotation: ``axis_angle``, a rotation vector; ``euler_xyz``, intrinsic x-y-z angles; ``rpy``,
            extrinsic (fixed-axis) x-y-z angles as in most data sets.
        relative_to: whether a delta is added to the last target or to the hand's current pose.
        position_scale: metres per unit; ``rotation_scale``: radians per unit.
        gripper: ``open_positive`` and ``close_positive`` are in [-1, 1] with the threshold at 0, ``open_01`` and
            ``close_01`` in [0, 1] with the threshold at 0.5.
        sticky: control steps for which a changed gripper command is held.
        hz: control rate; a divisor of 100.
        width: how many numbers they are, where a world takes others than these seven: as they are, then.
    """

    rotation: Rotation = "axis_angle"
    relative_to: Relative = "target"
    position_scale: float = 1.0
    rotation_scale: float = 1.0
    gripper: Gripper = "open_positive"
    sticky: int = 0
    hz: int = 5
    width: int = 7

    def __post_init__(self) -> None:
        for name, known in (("rotation", Rotation), ("relative_to", Relative), ("gripper", Gripper)):
            _expect_one_of(name, getattr(self, name), known)
        for name in ("position_scale", "rotation_scale"):
            scale = getattr(self, name)
            usable = isinstance(scale, int | float) and math.isfinite(scale) and scale != 0
            _expect(name, scale, "a finite number other than 0", usable)
        _expect_count("sticky", self.sticky, 0)
        _expect_count("width", self.width, 1)
        _expect_count("hz", self.hz, 1)
        _expect("hz", self.hz, f"a divisor of {SIM_HZ}", SIM_HZ % self.hz == 0)


@dataclass(frozen=True)
class PolicySpec:
    """What the policy is and what it asks for.

    Attributes:
        cameras: images to render.
        silhouettes: outlines of what the third-person camera sees; they need physics only, no renderer.
        state: proprioception ``(7,)``: position of the TCP in metres, its rotation vector in radians, and the
            gripper's opening, 1 for fully open.
        privileged: the simulator's state and the scene itself: for experts, never for a policy under test.
        execute: actions of a chunk to execute before the next call; None for all of them.
        deterministic: the same observations and seed always give the same actions.
        max_batch: the largest number of observations in one call of ``act``.
        calibrated: the true camera and light, and which objects the instruction means: for the seeing expert.
    """

    name: str
    _: KW_ONLY
    version: str = "1"
    action: ActionSpec = ActionSpec()
    cameras: tuple[CameraRequest, ...] = ()
    silhouettes: bool = False
    state: bool = False
    privileged: bool = False
    execute: int | None = 1
    deterministic: bool = True
    max_batch: int = 1
    provenance: Mapping[str, str] = field(default_factory=dict)
    calibrated: bool = False

    def __post_init__(self) -> None:
        for name in ("name", "version"):
            text = getattr(self, name)
            _expect(name, text, "a text", isinstance(text, str) and text != "")
        _expect("action", self.action, "an ActionSpec", isinstance(self.action, ActionSpec))
        requests = isinstance(self.cameras, tuple) and all(isinstance(c, CameraRequest) for c in self.cameras)
        _expect("cameras", self.cameras, "a tuple of CameraRequest", requests)
        names = [camera.name for camera in self.cameras]
        _expect("cameras", names, "different names", len(set(names)) == len(names))
        _expect_count("execute", 1 if self.execute is None else self.execute, 1)
        _expect_count("max_batch", self.max_batch, 1)
        kept = self.provenance
        texts = isinstance(kept, Mapping) and all(isinstance(text, str) for pair in kept.items() for text in pair)
        _expect("provenance", kept, "texts by name", texts)


@dataclass(frozen=True)
class EpisodeStart:
    """The start of a rollout. ``episode`` identifies it in all its observations.

    ``robot`` is that of the scene; empty where a client does not say, for the first one of its world. ``catalogue``: of
    the objects whose outlines are seen, for policies that ask for silhouettes.
    """

    episode: str
    instruction: str
    task: str
    seed: int
    robot: str = ""
    catalogue: Any = None


@dataclass(frozen=True, eq=False)
class Silhouette:
    """One outlined object in the third-person view, of unknown name.

    Attributes:
        pixels: ``(k, 2)`` visible pixels as (u, v) in [0, 1].
        colour: ``(3,)`` apparent colour, after light and saturation, in [0, 1].
        whole: fraction of the outline that is visible and inside the image, in [0, 1].
    """

    pixels: Array
    colour: Array
    whole: float


@dataclass(frozen=True, eq=False)
class Outlines:
    """What the third-person camera sees, reduced to outlines.

    Attributes:
        things: every object that is at least partly visible, in an order that carries no information.
        hand: ``(2,)`` the tool centre point as (u, v) in [0, 1]; None when out of view.
        table: ``(3,)`` apparent colour of the table.
    """

    things: tuple[Silhouette, ...]
    hand: Array | None
    table: Array


@dataclass(eq=False, slots=True)  # not frozen, since one is made at each step, in a third of the time
class Observation:
    """What the policy observes at a control step; fields that its spec does not ask for are empty.

    ``images``: uint8 ``(height, width, 3)`` by camera name. ``state``: float32, see ``PolicySpec.state``. ``fingers``:
    ``(2,)`` positions of both, metres, where a world measures them apart. ``privileged``: the ground truth, for
    experts; ``calibration``: how to read a picture. The world says what they are.
    """

    episode: str
    step: int
    instruction: str
    _: KW_ONLY
    images: Mapping[str, Picture] = field(default_factory=dict)
    state: NDArray[np.float32] | None = None
    fingers: NDArray[np.float32] | None = None
    outlines: Outlines | None = None
    privileged: Any = None
    calibration: Any = None


@dataclass(eq=False, slots=True)  # not frozen, as above
class ActionChunk:
    """``actions``: float ``(steps, 7)``, in units, and of the width, that the ``ActionSpec`` says."""

    actions: Array


class Policy(Protocol):
    """The policy under test.

    Every worker creates its own policy, unless the class or factory sets ``shared = True``. Then all workers share one
    policy in a separate process, which batches their simultaneous requests into one call of ``act``. Share a model that
    fills a device; a small model on a CPU is faster inside the workers. `vlafuzz serve` batches the requests of several
    connections in the same way. When ``act`` of a shared or served policy raises, it must not have advanced any
    rollout, as the observations may be retried one by one; ``harness.PartlyAnsweredError`` is for one that has.
    """

    @property
    def spec(self) -> PolicySpec:
        """What the policy is and what it asks for."""

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        """Begin these rollouts."""

    def act(self, observations: Sequence[Observation]) -> Sequence[ActionChunk]:
        """One chunk per observation, in the same order; the observations are of any live rollouts."""

    def close(self) -> None:
        """Release everything; no more rollouts follow."""


@runtime_checkable
class Finishing(Protocol):
    """A policy that keeps resources per rollout and must be told when a rollout ends."""

    def finish(self, episodes: Sequence[EpisodeStart]) -> None:
        """End these rollouts, which ``reset`` began, whatever their outcome. Raises nothing."""
