"""Sessions: a served policy and its connections. A connection is one rollout, unless it announces another."""

from __future__ import annotations

import itertools
import json
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from pydantic import BaseModel, ConfigDict, Field

from vlafuzz.errors import UsageError
from vlafuzz.policies.base import CameraRequest, EpisodeStart, Observation, Policy, PolicySpec
from vlafuzz.policies.batching import Request
from vlafuzz.serving.gather import RequestGatherer


class RolloutHeader(BaseModel):
    """What our own clients say about a rollout. ``observations_sent``: on earlier connections."""

    model_config = ConfigDict(frozen=True)

    task: str = ""
    seed: int = 0
    observations_sent: int = Field(default=0, alias="asked")


def read_header(header: str | None) -> RolloutHeader:
    """The header of a connection, the defaults when there is none; ValueError when it is malformed."""
    return RolloutHeader.model_validate(json.loads(header)) if header else RolloutHeader()


class ServedPolicy:
    """A policy that serves many connections; UsageError when it needs what no client can send."""

    def __init__(self, policy: Policy) -> None:
        if policy.spec.privileged or policy.spec.silhouettes:
            what = "the simulator's state" if policy.spec.privileged else "outlines"
            raise UsageError(
                f"{policy.spec.name} cannot be served: it wants {what}",
                hint="serve one that takes pictures, proprioception and words, such as mini",
            )
        self.spec, self.policy = policy.spec, RequestGatherer(policy)
        self._numbers = itertools.count()

    def session(self, header: RolloutHeader) -> ClientSession:
        """The session of a new connection; ValueError when its rollout began on another one."""
        if sent := header.observations_sent:
            raise ValueError(f"{sent} observations of this rollout came on a connection that is gone")
        return ClientSession(self.spec, self.policy, header, next(self._numbers))


class ClientSession:
    """A connection with its rollout."""

    def __init__(self, spec: PolicySpec, policy: RequestGatherer, header: RolloutHeader, number: int) -> None:
        self._spec, self._policy, self._header, self._number = spec, policy, header, number
        self._start: EpisodeStart | None = None
        self._begun = self._step = 0

    def expect(self, header: RolloutHeader) -> None:
        """End the rollout; the next observation begins another one."""
        self.end()
        self._header = header

    def act(self, instruction: object, pictures: Sequence[object], state: object) -> NDArray[np.float64]:
        """The actions ``(steps, 7)`` to execute; ValueError when the spec asks for another observation."""
        spec = self._spec
        if not isinstance(instruction, str):
            raise ValueError(f"an instruction that is no text: {type(instruction).__name__}")
        if len(pictures) < len(spec.cameras):
            wanted = ", ".join(f"{camera.name} {camera.width}x{camera.height}" for camera in spec.cameras)
            raise ValueError(f"{len(pictures)} pictures, expected {wanted}")
        images = {
            camera.name: _fitting(picture, camera)
            for camera, picture in zip(spec.cameras, pictures, strict=False)
        }
        proprioception = _proprioception(state) if spec.state else None
        start = self._start or self._begin(instruction)
        seen = Observation(start.episode, self._step, instruction, images=images, state=proprioception)
        (chunk,) = self._policy.ask(self._number, Request(act=[seen]))
        self._step += 1
        return chunk.actions[: spec.execute]

    def end(self) -> None:
        """End the rollout, whatever its outcome."""
        if self._start is not None:
            self._policy.ask(self._number, Request(over=[self._start.episode]))
        self._start = None

    def _begin(self, instruction: str) -> EpisodeStart:
        header = self._header
        start = EpisodeStart(f"served-{self._begun}", instruction, header.task, header.seed)
        self._policy.ask(self._number, Request(begin=[start]))
        self._start, self._step, self._begun = start, 0, self._begun + 1
        return start


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
