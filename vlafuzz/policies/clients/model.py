"""A model in its own terms: what is sent to it and what comes back, and how both are written down to train it with."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel

from vlafuzz.common.arrays import Array
from vlafuzz.common.reading import read_json, validated
from vlafuzz.errors import UsageError
from vlafuzz.policies.base import ActionSpec, CameraRequest, Observation, PolicySpec
from vlafuzz.policies.clients.conventions import LAYOUTS, OWN, PLACE, ROTATIONS, STATES, sent
from vlafuzz.policies.clients.options import SIDE, ProfiledOptions
from vlafuzz.policies.clients.servers import options_of
from vlafuzz.policies.harness import metric, written_as

PICTURES = "observation.images."
_GRIPPER = {"open_positive": (-1.0, 1.0), "close_positive": (1.0, -1.0), "open_01": (0.0, 1.0), "close_01": (1.0, 0.0)}
_OF_ACTIONS = ("rotation", "position_scale", "rotation_scale", "relative_to", "sticky", "hz")  # options as in the spec
Written = NDArray[np.float32]


class Model:
    """What is sent to a model and what comes back, by the keys, pictures and conventions of its options."""

    def __init__(self, name: str, options: ProfiledOptions) -> None:
        self._options, self.layout = options, options.layout
        server, about = getattr(options, "protocol", ""), {name: getattr(options, name) for name in _OF_ACTIONS}
        self.spec = PolicySpec(
            name,
            version=options.version or "1",
            action=ActionSpec(**about, gripper=options.gripper or "open_positive"),
            cameras=_cameras(options),
            state=self.layout is not None,
            execute=options.execute,
            deterministic=options.deterministic,
            max_batch=options.batch,
            provenance={"server": server, "state": self.layout or "none"} | options.provenance(),
        )

    def message(self, seen: Observation) -> dict[str, Any]:
        """An observation under the model's own keys, third-person picture first."""
        options = self._options
        keys = {"front": options.image_key, "wrist": options.wrist_key}
        message: dict[str, Any] = {keys[camera.name]: seen.images[camera.name] for camera in self.spec.cameras}
        if self.layout is not None and seen.state is not None:
            message[options.state_key] = sent(self.layout, seen)
        return message | {options.instruction_key: seen.instruction}

    def checked(self, chunk: Array) -> Array:
        """The model's answer; ValueError when it is not as long as the options say."""
        expected = self._options.chunk
        if expected is not None and len(chunk) != expected:
            raise ValueError(f"a chunk of {len(chunk)} actions, expected chunk={expected}")
        return chunk


def _cameras(options: ProfiledOptions) -> tuple[CameraRequest, ...]:
    """The cameras of a model: third-person, unless its size is (0, 0), and wrist, by default of the same size."""
    size = options.camera or (SIDE, SIDE)
    cameras = [CameraRequest("front", *size)] if size != (0, 0) else []
    if options.wrist:
        wrist = options.wrist_camera or (size if cameras else (SIDE, SIDE))
        cameras.append(CameraRequest("wrist", *wrist, role="wrist"))
    return tuple(cameras)


class _Config(BaseModel):
    """The inputs, by name, of a policy that lerobot saved."""

    input_features: dict[str, Any] = {}


@dataclass(frozen=True, eq=False)
class Interface:
    """What a policy sees and how it acts.

    Attributes:
        spec: of the policy; one without cameras gets a third-person picture.
        layout: of its state, a name of ``LAYOUTS``; our own where it asks for none.
        pictures: names of its pictures, by camera.
    """

    spec: PolicySpec
    layout: str
    pictures: Mapping[str, str]

    @property
    def action_names(self) -> list[str]:
        return [*(f"d{name}" for name in (*PLACE, *ROTATIONS[self.spec.action.rotation])), "gripper"]

    @property
    def state_names(self) -> list[str]:
        return list(STATES[self.layout])

    def state(self, seen: Observation) -> Written:
        """The proprioception that the policy gets, in its layout."""
        return sent(self.layout, seen)

    def written(self, action: Array) -> Written:
        """``(7,)`` metres, radians and 1 or -1 for an open or closed gripper, as the policy writes it."""
        numbers = written_as(action, self.spec.action)
        numbers[-1] = _GRIPPER[self.spec.action.gripper][int(action[6] > 0)]
        return np.asarray(numbers, dtype=np.float32)

    def metric(self, written: Written) -> Array:
        """``(7,)`` metres and radians; the gripper as it is written."""
        return metric(written.astype(np.float64), self.spec.action)


def interface_of(policy: str, spec: str) -> Interface:
    """The interface of a policy by name and spec, as runs keep them; a UsageError for what is not known any more."""
    own, options = _spec(policy, json.loads(spec)), options_of(policy)
    pictures = {camera.name: PICTURES + _picture(camera.name, policy, options) for camera in own.cameras}
    state = own.provenance.get("state", "")
    return Interface(own, state if state in LAYOUTS else OWN, pictures)


def _spec(policy: str, written: Mapping[str, Any]) -> PolicySpec:
    known = {part.name for part in fields(PolicySpec)} - {"action", "cameras"}
    others = {"name": policy} | {name: value for name, value in written.items() if name in known}
    try:
        cameras = tuple(CameraRequest(**camera) for camera in written.get("cameras", ()))
        action = ActionSpec(**written.get("action", {}))
    except TypeError as error:
        problem = f"{policy} is described as another version does: {error}"
        raise UsageError(problem, hint="use the version that began the run") from None
    return PolicySpec(**others, action=action, cameras=cameras or (CameraRequest("front", SIDE, SIDE),))


def _picture(camera: str, policy: str, options: Any) -> str:
    """The name of a camera's picture: our own, but for policies from a folder, which have theirs."""
    if getattr(options, "protocol", None) != "lerobot":
        return camera
    key = "wrist_key" if camera == "wrist" else "image_key"
    if key in options.model_fields_set:
        return str(getattr(options, key)).removeprefix(PICTURES)
    folder = policy.partition(":")[2].partition("?")[0]
    config, hint = Path(folder).expanduser() / "config.json", "name the folder that lerobot saved"
    if not config.is_file():
        return camera
    saved = validated(_Config, read_json(config, UsageError, hint), config, UsageError, hint)
    names = [name.removeprefix(PICTURES) for name in saved.input_features if name.startswith(PICTURES)]
    return names[0] if len(names) == 1 else camera
