"""Models whose servers declare nothing: options describe them, and are translated to a policy's spec."""

import math
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field

from vlafuzz.policies.base import ActionSpec, Observation, PolicySpec
from vlafuzz.policies.clients.conventions import LAYOUTS, OWN, SCALED, Convention, sent
from vlafuzz.policies.clients.profiles import known_profiles
from vlafuzz.policies.clients.remote import SIDE, CommonOptions, Size, State, cameras_of, divisor


def _scale(number: float) -> float:
    """A scale may be negative, for models trained with a controller that turns the wrong way."""
    if not math.isfinite(number) or number == 0:
        raise ValueError(f"expected a number other than 0, got {number}")
    return number


class ProfiledOptions(CommonOptions):
    """A model's options, from a profile or from the user.

    Attributes:
        state: ``0``, ``1`` (our own layout) or the name of a layout.
        action: deltas or target poses of the end effector; actions of joints are refused.
        frame: of deltas: the robot's base, or the hand (tool).
        rotation: a name of ``conventions.ROTATIONS``.
        hz: control rate, a divisor of 100.
        chunk: actions in every reply; None to accept any number.
        wrist_camera: width and height of the wrist picture; None for those of ``camera``.
        image_key: key of the third-person picture in messages; ``wrist_key`` and the others likewise.
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
        pose, tool = self.action == "eef_pose", self.frame == "tool"
        return Convention(pose, tool, self.rotation, self.position_scale, self.rotation_scale)

    @property
    def layout(self) -> str | None:
        """The layout in which proprioception is sent; None when it is not sent."""
        layout = OWN if self.state == "1" else self.state
        return layout if layout in LAYOUTS else None

    def refusals(self) -> list[tuple[str, str]]:
        problems = []
        if self.action.startswith("joint"):
            message = f"its actions are of joints ({self.action.replace('_', ' ')}), which cannot be executed"
            problems.append((message, "supported: action=eef_delta and action=eef_pose"))
        if self.state == "joint_positions":
            message = "joint positions cannot be sent as proprioception"
            problems.append((message, f"supported: {', '.join(LAYOUTS)}, 0"))
        try:
            divisor(self.hz)
        except ValueError as error:
            problems.append((f"hz: {error}", "such as hz=5, hz=10 or hz=20"))
        if self.convention.measured and self.execute != 1:
            problems.append(("poses and moves in the hand's frame are executed one at a time", "execute=1"))
        if self.rotation not in SCALED and self.rotation_scale != 1:
            problems.append((f"rotation_scale: {self.rotation} has no scale", "leave it out"))
        if self.chunk and (self.execute or 0) > self.chunk:
            message = f"execute={self.execute} of a chunk of {self.chunk}"
            problems.append((message, f"execute at most {self.chunk}"))
        return problems


class Model:
    """A model as its options describe it: its spec, and the translation of observations and actions."""

    def __init__(self, name: str, options: ProfiledOptions) -> None:
        self._name, self._options, self._convention = name, options, options.convention
        self._layout = LAYOUTS.get(options.layout or "")
        state = options.layout or "none"
        self.spec = PolicySpec(
            name,
            version=options.version or "1",
            action=_action(options),
            cameras=cameras_of(
                options.camera or (SIDE, SIDE), options.wrist_camera, wrist=bool(options.wrist)
            ),
            state=self._layout is not None or self._convention.measured,
            execute=options.execute,
            deterministic=options.deterministic,
            max_batch=options.batch,
            provenance={"server": options.protocol, "state": state} | options.provenance(),
        )

    def message(self, seen: Observation) -> dict[str, Any]:
        """An observation under the model's own keys, third-person picture first."""
        options = self._options
        keys = {"front": options.image_key, "wrist": options.wrist_key}
        names = [camera.name for camera in self.spec.cameras]
        message: dict[str, Any] = {keys[name]: seen.images[name] for name in names}
        if self._layout is not None and seen.state is not None:
            message[options.state_key] = sent(self._layout, seen)
        return message | {options.instruction_key: seen.instruction}

    def sends(self, key: str) -> str:
        """A hint: which profiles and options send something under this key."""
        options = self._options
        profiles = [
            f"?profile={name}"
            for name, profile in known_profiles().items()
            if key in (profile.options_for(options.protocol) or {}).values()
        ]
        flags = {options.state_key: ["state=1"], options.wrist_key: ["wrist=1"]}
        if tries := profiles + flags.get(key, []):
            return f"sent with {' or '.join(tries)}"
        return f"name the model's own keys: image_key=…, instruction_key=…, state=1&state_key={key}"

    def actions(self, chunk: NDArray[np.float64], seen: Observation) -> NDArray[np.float64]:
        """The model's answer in the units of the spec; ValueError when the options describe it otherwise."""
        expected = self._options.chunk
        if expected is not None and len(chunk) != expected:
            raise ValueError(f"a chunk of {len(chunk)} actions, expected chunk={expected}")
        if self._convention.plain:
            return chunk
        hand = np.zeros(6) if seen.state is None else seen.state[:6].astype(np.float64)
        return self._convention.moves(chunk, hand)


def _action(options: ProfiledOptions) -> ActionSpec:
    units: dict[str, Any] = {}
    if options.convention.plain:  # else ``Model.actions`` makes them metric
        units = options.model_dump(include={"rotation", "position_scale", "rotation_scale"})
    return ActionSpec(
        **units,
        relative_to="current" if options.convention.measured else options.relative_to,
        gripper=options.gripper or "open_positive",
        sticky=options.sticky,
        hz=options.hz,
    )
