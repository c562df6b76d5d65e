"""Host: a policy that many connections ask. Each is a rollout, unless it says that another begins."""

from __future__ import annotations

import itertools
import json
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from pydantic import BaseModel, ConfigDict

from vlafuzz.errors import UsageError
from vlafuzz.policies.base import CameraRequest, EpisodeStart, Observation, Policy, PolicySpec
from vlafuzz.policies.batching import Asked
from vlafuzz.serving.gather import Gathered


class Told(BaseModel):
    """What a client says about a rollout. Others than ours say nothing.

    ``asked``: how many observations of it were sent on earlier connections.
    """

    model_config = ConfigDict(frozen=True)

    task: str = ""
    seed: int = 0
    asked: int = 0


def told_by(header: str | None) -> Told:
    """What the header of a connection says.

    Raises:
        ValueError: it is none of ours.
    """
    return Told.model_validate(json.loads(header)) if header else Told()


class ServedPolicy:
    """Lets connections ask a policy, several of them in one call where they ask at the same time.

    Raises:
        UsageError: the policy needs what no client can send.
    """

    def __init__(self, policy: Policy) -> None:
        if policy.spec.privileged or policy.spec.silhouettes:
            what = "the simulator's state" if policy.spec.privileged else "outlines"
            raise UsageError(
                f"{policy.spec.name} cannot be served: it wants {what}",
                hint="serve one that takes pictures, proprioception and words, such as mini",
            )
        self.spec, self.policy = policy.spec, Gathered(policy)
        self._numbers = itertools.count()

    def session(self, told: Told) -> ClientSession:
        """A new connection.

        Raises:
            ValueError: its rollout began on another one.
        """
        if told.asked:
            raise ValueError(f"{told.asked} observations of this rollout came on a connection that is gone")
        return ClientSession(self.spec, self.policy, told, next(self._numbers))


class ClientSession:
    """A connection, and its rollout."""

    def __init__(self, spec: PolicySpec, policy: Gathered, told: Told, number: int) -> None:
        self._spec, self._policy, self._told, self._number = spec, policy, told, number
        self._start: EpisodeStart | None = None
        self._begun = self._step = 0

    def expect(self, told: Told) -> None:
        """Another rollout begins, with the next observation."""
        self.end()
        self._told = told

    def act(self, instruction: object, pictures: Sequence[object], state: object) -> NDArray[np.float64]:
        """The actions ``(steps, 7)`` that are to be executed before the next observation.

        Raises:
            ValueError: not what the policy's spec asks for.
        """
        spec = self._spec
        if not isinstance(instruction, str):
            raise ValueError(f"an instruction that is no text: {type(instruction).__name__}")
        if len(pictures) < len(spec.cameras):
            wanted = ", ".join(f"{camera.name} {camera.width}x{camera.height}" for camera in spec.cameras)
            raise ValueError(f"{len(pictures)} pictures, expected {wanted}")
        images = {
            camera.name: _fitting(found, camera)
            for camera, found in zip(spec.cameras, pictures, strict=False)
        }
        known = _proprioception(state) if spec.state else None
        start = self._start or self._begin(instruction)
        seen = Observation(start.episode, self._step, instruction, images, known)
        (chunk,) = self._policy.ask(self._number, Asked(act=[seen]))
        self._step += 1
        return chunk.actions[: spec.execute]

    def end(self) -> None:
        """The rollout is over, whatever came of it."""
        if self._start is not None:
            self._policy.ask(self._number, Asked(over=[self._start.episode]))
        self._start = None

    def _begin(self, instruction: str) -> EpisodeStart:
        told = self._told
        start = EpisodeStart(f"served-{self._begun}", instruction, told.task, told.seed)
        self._policy.ask(self._number, Asked(begin=[start]))
        self._start, self._step, self._begun = start, 0, self._begun + 1
        return start


def _fitting(found: Any, camera: CameraRequest) -> NDArray[np.uint8]:
    """A picture in the camera's size: other clients send what their own models take."""
    if not isinstance(found, np.ndarray) or found.dtype != np.uint8 or found.ndim != 3 or found.shape[2] != 3:
        told = f"{found.dtype} {found.shape}" if isinstance(found, np.ndarray) else type(found).__name__
        raise ValueError(f"the picture {camera.name!r} is {told}, expected uint8 (height, width, 3)")
    if found.shape[:2] == (camera.height, camera.width):
        return found
    resized = Image.fromarray(found).resize((camera.width, camera.height), Image.Resampling.BILINEAR)
    return np.array(resized, dtype=np.uint8)


def _proprioception(found: object) -> NDArray[np.float32]:
    state = np.asarray([] if found is None else found)
    if state.shape != (7,) or state.dtype.kind not in "iuf":
        raise ValueError(
            f"proprioception of shape {state.shape}, expected 7 numbers: position, rotation vector, opening"
        )
    return state.astype(np.float32)
