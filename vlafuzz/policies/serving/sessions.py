"""Sessions: a served policy and its connections. A connection is one rollout, unless it announces another."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from pydantic import BaseModel

from vlafuzz.policies.base import CameraRequest, EpisodeStart, Observation
from vlafuzz.policies.batching import Request, ServedPolicy

MAX_BYTES = 64 << 20  # of an observation


class _Begun(BaseModel, frozen=True):
    """What a client says when a rollout begins."""

    task: str = ""
    seed: int = 0


class ClientSession:
    """A connection with its rollout."""

    def __init__(self, policy: ServedPolicy) -> None:
        self._spec, self._policy, self._number = policy.spec, policy, policy.newcomer()
        self._said = _Begun()
        self._start: EpisodeStart | None = None
        self._begun = self._step = 0

    def begin(self, task: object) -> None:
        """End the rollout; the next observation begins one of this task. ValueError where it is malformed."""
        self.end()
        self._said = _Begun.model_validate(task)

    def act(self, instruction: object, pictures: Sequence[object], state: object) -> NDArray[np.float64]:
        """The actions ``(steps, 7)`` to execute; ValueError when the spec asks for another observation."""
        spec = self._spec
        if not isinstance(instruction, str):
            raise ValueError(f"an instruction that is no text: {type(instruction).__name__}")
        if len(pictures) < len(spec.cameras):
            wanted = ", ".join(f"{camera.name} {camera.width}x{camera.height}" for camera in spec.cameras)
            raise ValueError(f"{len(pictures)} pictures, expected {wanted}")
        pairs = zip(spec.cameras, pictures, strict=False)
        images = {camera.name: _fitting(picture, camera) for camera, picture in pairs}
        proprioception = _proprioception(state) if spec.state else None
        if self._start is None:
            start = EpisodeStart(f"served-{self._begun}", instruction, self._said.task, self._said.seed)
            self._policy.ask(self._number, Request(begin=[start]))
            self._start, self._step, self._begun = start, 0, self._begun + 1
        seen = Observation(self._start.episode, self._step, instruction, images=images, state=proprioception)
        (chunk,) = self._policy.ask(self._number, Request(act=[seen]))
        self._step += 1
        return chunk.actions[: spec.execute]

    def end(self) -> None:
        """End the rollout, whatever its outcome."""
        if self._start is not None:
            self._policy.ask(self._number, Request(over=[self._start.episode]))
        self._start = None


def _fitting(picture: Any, camera: CameraRequest) -> NDArray[np.uint8]:
    """A picture resized to the camera's size, since other clients send what their own models take."""
    is_array = isinstance(picture, np.ndarray)
    if not is_array or picture.dtype != np.uint8 or picture.ndim != 3 or picture.shape[2] != 3:
        kind = f"{picture.dtype} {picture.shape}" if is_array else type(picture).__name__
        raise ValueError(f"the picture {camera.name!r} is {kind}, expected uint8 (height, width, 3)")
    if picture.shape[:2] == (camera.height, camera.width):
        return np.asarray(picture)
    resized = Image.fromarray(picture).resize((camera.width, camera.height), Image.Resampling.BILINEAR)
    return np.array(resized, dtype=np.uint8)


def _proprioception(numbers: object) -> NDArray[np.float32]:
    state = np.asarray([] if numbers is None else numbers)
    if state.shape != (7,) or state.dtype.kind not in "iuf":
        raise ValueError(
            f"proprioception of shape {state.shape}, expected 7 numbers: position, rotation vector, opening"
        )
    return state.astype(np.float32)
