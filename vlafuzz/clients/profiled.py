"""Models whose servers declare nothing: what their options say, and what that is in our words."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field

from vlafuzz.clients.conventions import SCALED, Convention
from vlafuzz.clients.layouts import LAYOUTS, OWN
from vlafuzz.clients.remote import SIDE, Common, Size, State, divisor
from vlafuzz.errors import UsageError
from vlafuzz.policies.base import ActionSpec, CameraRequest, Observation, PolicySpec


def _scale(number: float) -> float:
    """Below zero for models that learned with a controller which turns the wrong way."""
    if not math.isfinite(number) or number == 0:
        raise ValueError(f"expected a number other than 0, got {number}")
    return number


class Profiled(Common):
    """What the user, or a profile, says about a model.

    Attributes:
        state: ``0``, ``1`` (in our own layout) or the name of a layout.
        action: how the hand is to move, or where it is to be; of joints nothing can be executed.
        frame: a move is along and about the axes of the robot's base, or of the hand.
        rotation: a name of ``conventions.ROTATIONS``.
        hz: control rate, a divisor of 100.
        chunk: actions in every reply; None for whatever comes.
        wrist_camera: width and height of the wrist's picture; None for the same as ``camera``.
        image_key: what the picture is called on the wire; so are the other keys.
    """

    state: Literal[State, "joint_positions"] = "0"
    action: Literal["eef_delta", "eef_pose", "joint_delta", "joint_position", "joint_velocity"] = "eef_delta"
    frame: Literal["base", "tool"] = "base"
    rotation: Literal[
        "axis_angle",
        "rpy",
        "euler_xyz",
        "quaternion_xyzw",
        "quaternion_wxyz",
        "rot6d",
        "rot6d_interleaved",
    ] = "axis_angle"
    rotation_scale: Annotated[float, AfterValidator(_scale)] = 1.0
    hz: int = Field(default=5, ge=1)
    chunk: int | None = Field(default=None, ge=1)
    wrist_camera: Size | None = None
    image_key: str = "image"
    wrist_key: str = "wrist_image"
    state_key: str = "state"
    instruction_key: str = "instruction"

    @property
    def convention(self) -> Convention:
        """What the numbers of an action are."""
        pose, tool = self.action == "eef_pose", self.frame == "tool"
        return Convention(pose, tool, self.rotation, self.position_scale, self.rotation_scale)

    @property
    def layout(self) -> str | None:
        """In which layout proprioception is sent; None for not at all."""
        told = OWN if self.state == "1" else self.state
        return told if told in LAYOUTS else None

    def check(self, name: str) -> None:
        """Refuse what cannot be executed.

        Raises:
            UsageError: with what it is.
        """
        for told, hint in self.refusals():
            raise UsageError(f"{name!r}: {told}", hint=hint)

    def refusals(self) -> list[tuple[str, str]]:
        """What cannot be executed or sent, each with a hint."""
        found = []
        if self.action.startswith("joint"):
            what = self.action.replace("_", " ")
            found.append((f"its actions are of joints ({what}), which cannot be executed",
                          "supported: action=eef_delta and action=eef_pose"))  # fmt: skip
        if self.state == "joint_positions":
            found.append(("joints cannot be sent as proprioception", f"supported: {', '.join(LAYOUTS)}, 0"))
        try:
            divisor(self.hz)
        except ValueError as error:
            found.append((f"hz: {error}", "such as hz=5, hz=10 or hz=20"))
        if self.convention.measured and self.execute != 1:
            found.append(("poses and moves in the hand's frame are executed one at a time", "execute=1"))
        if self.rotation not in SCALED and self.rotation_scale != 1:
            found.append((f"rotation_scale: {self.rotation} has no scale", "leave it"))
        if self.chunk and (self.execute or 0) > self.chunk:
            found.append((f"execute={self.execute} of a chunk of {self.chunk}", "execute as many or fewer"))
        return found


class Model:
    """A model by its options: the spec, what is sent for an observation, and what the reply means."""

    def __init__(self, name: str, options: Profiled) -> None:
        self._name, self._options, self._convention = name, options, options.convention
        self._layout = LAYOUTS.get(options.layout or "")
        self.spec = PolicySpec(
            name,
            action=_action(options),
            cameras=_cameras(options),
            state=self._layout is not None or self._convention.measured,
            execute=options.execute,
            deterministic=options.deterministic,
            max_batch=options.batch,
            provenance={
                "server": options.protocol,
                "profile": options.profile or "none",
                "state": options.layout or "none",
            },
        )

    def message(self, seen: Observation) -> dict[str, Any]:
        """An observation under the model's own keys, third-person picture first."""
        options = self._options
        keys = {"front": options.image_key, "wrist": options.wrist_key}
        told: dict[str, Any] = {keys[camera.name]: seen.images[camera.name] for camera in self.spec.cameras}
        if self._layout is not None and seen.state is not None:
            told[options.state_key] = self._layout(seen.state)
        return told | {options.instruction_key: seen.instruction}

    def actions(self, found: NDArray[np.float64], seen: Observation) -> NDArray[np.float64]:
        """What the model answered, as the spec says it.

        Raises:
            ValueError: not a chunk as the options say.
        """
        expected = self._options.chunk
        if expected is not None and len(found) != expected:
            raise ValueError(f"a chunk of {len(found)} actions, expected chunk={expected}")
        if self._convention.plain:
            return found
        hand = np.zeros(6) if seen.state is None else seen.state[:6].astype(np.float64)
        return self._convention.moves(found, hand)


def _action(options: Profiled) -> ActionSpec:
    plain, measured = options.convention.plain, options.convention.measured
    said: Mapping[str, Any] = {
        "rotation": options.rotation,
        "position_scale": options.position_scale,
        "rotation_scale": options.rotation_scale,
    }
    return ActionSpec(
        **said if plain else {},  # else they are metric before they get there
        relative_to="current" if measured else options.relative_to,
        gripper=options.gripper or "open_positive",
        sticky=options.sticky,
        hz=options.hz,
    )


def _cameras(options: Profiled) -> tuple[CameraRequest, ...]:
    size = options.camera or (SIDE, SIDE)
    cameras = [CameraRequest("front", *size)] if size != (0, 0) else []
    if options.wrist:
        small = options.wrist_camera or (size if cameras else (SIDE, SIDE))
        cameras.append(CameraRequest("wrist", *small, role="wrist"))
    return tuple(cameras)
