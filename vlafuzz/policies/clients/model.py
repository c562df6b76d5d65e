"""A model as its options describe it: its spec, and the translation of observations and actions."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vlafuzz.policies.base import ActionSpec, CameraRequest, Observation, PolicySpec
from vlafuzz.policies.clients.conventions import sent
from vlafuzz.policies.clients.options import SIDE, ProfiledOptions


class Model:
    """What is sent to a model and what comes back, by the keys, pictures and conventions of its options."""

    def __init__(self, name: str, options: ProfiledOptions) -> None:
        self._options, self._convention, self.layout = options, options.convention, options.layout
        units: dict[str, Any] = {}
        if self._convention.plain:  # else ``actions`` makes them metric
            units = {name: getattr(options, name) for name in ("rotation", "position_scale", "rotation_scale")}
        server = getattr(options, "protocol", "")
        self.spec = PolicySpec(
            name,
            version=options.version or "1",
            action=ActionSpec(
                **units,
                relative_to="current" if self._convention.measured else options.relative_to,
                gripper=options.gripper or "open_positive",
                sticky=options.sticky,
                hz=options.hz,
            ),
            cameras=_cameras(options),
            state=self.layout is not None or self._convention.measured,
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

    def actions(self, chunk: NDArray[np.float64], seen: Observation) -> NDArray[np.float64]:
        """The model's answer in the units of the spec; ValueError when the options describe it otherwise."""
        expected = self._options.chunk
        if expected is not None and len(chunk) != expected:
            raise ValueError(f"a chunk of {len(chunk)} actions, expected chunk={expected}")
        if self._convention.plain:
            return chunk
        hand = np.zeros(6) if seen.state is None else seen.state[:6].astype(np.float64)
        return self._convention.moves(chunk, hand)


def _cameras(options: ProfiledOptions) -> tuple[CameraRequest, ...]:
    """Third-person, unless its size is (0, 0), then wrist, by default of the same size."""
    size = options.camera or (SIDE, SIDE)
    cameras = [CameraRequest("front", *size)] if size != (0, 0) else []
    if options.wrist:
        wrist = options.wrist_camera or (size if cameras else (SIDE, SIDE))
        cameras.append(CameraRequest("wrist", *wrist, role="wrist"))
    return tuple(cameras)
