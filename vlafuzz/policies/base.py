"""Policy: the policy under test, what it asks for and what it gets. The harness drives its rollouts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from vlafuzz.objects.catalogue import Catalogue
from vlafuzz.objects.model import ObjectModel
from vlafuzz.scene import Scene
from vlafuzz.tasks.state import State


@dataclass(frozen=True)
class CameraRequest:
    """A picture that the policy wants with every observation. ``width`` and ``height`` in pixels."""

    name: str
    width: int
    height: int
    role: Literal["third_person", "wrist"] = "third_person"


@dataclass(frozen=True)
class ActionSpec:
    """What the numbers of an action mean. The default is the robot's own metric controller.

    Seven numbers: translation (``position_scale`` metres a unit, along the robot's base axes), rotation
        (``rotation_scale``
    radians a unit, about these axes), gripper. ``relative_to``: a delta counts from the last target or
    from where the hand is.

    Attributes:
        rotation: a rotation vector; or angles about x, y, z: ``euler_xyz`` about the axes that turn along, as
            ManiSkill means it, ``rpy`` about the fixed ones, as most data sets do.
        gripper: ``open_positive`` and ``close_positive``: in [-1, 1], cut at 0; ``open_01`` and
            ``close_01``: in [0, 1], cut at 0.5.
        sticky: control steps for which a change of the gripper's command is kept.
        hz: control rate; a divisor of 100.
    """

    rotation: Literal["axis_angle", "euler_xyz", "rpy"] = "axis_angle"
    relative_to: Literal["target", "current"] = "target"
    position_scale: float = 1.0
    rotation_scale: float = 1.0
    gripper: Literal["open_positive", "close_positive", "open_01", "close_01"] = "open_positive"
    sticky: int = 0
    hz: int = 5


@dataclass(frozen=True)
class PolicySpec:
    """What the policy is and what it asks for.

    Attributes:
        cameras: pictures to render.
        silhouettes: wants outlines of what the third-person camera sees (physics only, no renderer).
        state: wants proprioception: ``(7,)`` TCP position in metres, its rotation vector in radians,
            opening, 1 for wide open.
        privileged: wants the simulator's state and the scene itself: for experts, never for a policy under
            test.
        execute: actions of a chunk to execute before asking again; None for all of them.
        deterministic: same observations and seed, same actions.
        max_batch: most observations in one call of ``act``.
    """

    name: str
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


@dataclass(frozen=True)
class EpisodeStart:
    """A rollout is about to begin. ``episode`` names it in all later observations, ``robot`` the rig."""

    episode: str
    instruction: str
    task: str
    seed: int
    robot: str = "panda"


@dataclass(frozen=True, eq=False)
class Silhouette:
    """One outlined thing in the third-person picture, of unknown name.

    Attributes:
        pixels: ``(k, 2)`` visible pixels as (u, v) in [0, 1].
        colour: ``(3,)`` as it appears, after light and saturation, in [0, 1].
        whole: share of its outline that is visible and inside the picture, in [0, 1].
    """

    pixels: NDArray[np.float64]
    colour: NDArray[np.float64]
    whole: float


@dataclass(frozen=True, eq=False)
class Outlines:
    """What the third-person camera sees, reduced to outlines.

    Attributes:
        things: every object of which something is visible, in no telling order.
        hand: ``(2,)`` where the tool centre point appears, as (u, v) in [0, 1]; None when out of view.
        table: ``(3,)`` apparent colour of the table.
    """

    things: tuple[Silhouette, ...]
    hand: NDArray[np.float64] | None
    table: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Privileged:
    """What only an expert may know. ``done``: success holds at this moment."""

    scene: Scene
    models: tuple[ObjectModel, ...]
    state: State
    done: bool = False


@dataclass(frozen=True, eq=False)
class Observation:
    """What the policy gets at a control step; what its spec does not ask for is empty.

    ``images``: uint8 ``(height, width, 3)`` by camera name. ``state``: float32, see ``PolicySpec.state``.
    """

    episode: str
    step: int
    instruction: str
    images: Mapping[str, NDArray[np.uint8]] = field(default_factory=dict)
    state: NDArray[np.float32] | None = None
    outlines: Outlines | None = None
    privileged: Privileged | None = None


@dataclass(frozen=True, eq=False)
class ActionChunk:
    """``actions``: float ``(steps, 7)`` in the units of the spec."""

    actions: NDArray[np.float64]


class Policy(Protocol):
    """The policy under test.

    Every worker has one of its own, unless what makes it (the class, or the factory that its name names) says
    ``shared = True``: then there is one for all of them, in a process of its own, which is asked for whatever
    they want at the same time in one call. That is for a model that fills a device; a small one on a CPU is
    faster in the workers. `vlafuzz serve` asks in one call, too, for what several connections want at the
    same time. A policy that is shared or served and whose ``act`` raises has gone on with none of the
    observations: they may be asked again, one by one.
    """

    @property
    def spec(self) -> PolicySpec:
        """What it is and what it asks for."""

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        """These rollouts begin."""

    def act(self, observations: Sequence[Observation]) -> Sequence[ActionChunk]:
        """One chunk an observation, in the same order; any subset of the live episodes."""

    def close(self) -> None:
        """No more rollouts."""


@runtime_checkable
class Knowing(Protocol):
    """A policy that knows the objects that there are: their shapes, colours and names."""

    def know(self, catalogue: Catalogue) -> None:
        """These are the objects of all scenes from now on."""


@runtime_checkable
class Finishing(Protocol):
    """A policy that has to know when a rollout is over: it holds something for each."""

    def finish(self, episodes: Sequence[EpisodeStart]) -> None:
        """These rollouts, which ``reset`` began, are over, whatever came of them. Raises nothing."""
