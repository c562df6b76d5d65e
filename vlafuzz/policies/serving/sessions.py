"""Sessions: a served policy and its connections. A connection is one rollout, unless it announces another."""

from __future__ import annotations

import itertools
import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from threading import Condition
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from pydantic import BaseModel, Field

from vlafuzz.errors import PolicyError, UsageError
from vlafuzz.policies.base import ActionChunk, CameraRequest, EpisodeStart, Observation, Policy
from vlafuzz.policies.batching import Answer, BatchingPolicy, Request
from vlafuzz.policies.clients.options import ProfiledOptions
from vlafuzz.policies.clients.wire import short

MAX_BYTES = 64 << 20  # of an observation
# Seconds that requests wait for the next one: less than a simulator needs for a step and an image, and only
# while there are rollouts without a pending request.
WAIT = 0.005
PATIENCE = 0.05  # share of the time of the last answer that requests wait, if that is longer


class RolloutHeader(BaseModel, frozen=True):
    """What our own clients say about a rollout. ``observations_sent``: on earlier connections."""

    task: str = ""
    seed: int = 0
    observations_sent: int = Field(default=0, alias="asked")


@dataclass(eq=False)
class _Pending:
    caller: int
    request: Request
    answer: Answer | None = None


class ServedPolicy:
    """One policy for many connections, each with a thread; it has no thread of its own.

    The first caller, while nobody else is being served, gathers the requests of the others until none has come for
    ``wait`` seconds (longer if the policy is slow), has all of them answered, and distributes the answers. Requests
    that arrive meanwhile are gathered by the next caller.

    Raises:
        UsageError: the policy needs what no client can send.
    """

    def __init__(self, policy: Policy, wait: float = WAIT) -> None:
        if policy.spec.privileged or policy.spec.silhouettes:
            what = "the simulator's state" if policy.spec.privileged else "outlines"
            hint = "serve one that takes pictures, proprioception and words, such as mini"
            raise UsageError(f"{policy.spec.name} cannot be served: it wants {what}", hint)
        self.spec, self._numbers = policy.spec, itertools.count()
        self._batching, self._most, self._wait = BatchingPolicy(policy), policy.spec.max_batch, wait
        self._changed, self._busy, self._took = Condition(), False, 0.0
        self._pending: list[_Pending] = []
        self._live: set[int] = set()  # callers in the middle of a rollout, which will send requests

    def session(self, header: str | None = None) -> ClientSession:
        """The session of a new connection; ValueError when its header is malformed or continues a rollout."""
        rollout = RolloutHeader.model_validate(json.loads(header or "{}"))
        if sent := rollout.observations_sent:
            raise ValueError(f"{sent} observations of this rollout came on a connection that is gone")
        return ClientSession(self, rollout, next(self._numbers))

    def ask(self, caller: int, request: Request) -> Sequence[ActionChunk]:
        """One chunk per observation; blocks until they are there, and raises what the policy raised."""
        mine = _Pending(caller, request)
        with self._changed:
            self._pending.append(mine)
            (self._live.discard if request.over else self._live.add)(caller)
            self._changed.notify_all()
            self._changed.wait_for(lambda: mine.answer is not None or not self._busy)
            if mine.answer is None:
                self._busy = True
                # A client that sends many observations needs longer for all of them than ``wait``.
                while not self._complete() and self._changed.wait(max(self._wait, PATIENCE * self._took)):
                    pass  # another request has come
        if mine.answer is None:
            self._answer_all()
        assert mine.answer is not None
        if isinstance(mine.answer, PolicyError):
            raise mine.answer
        return mine.answer

    def _complete(self) -> bool:
        """Whether there is no reason to wait for further requests."""
        acting = sum(bool(pending.request.act) for pending in self._pending)
        return not acting or acting >= min(self._most, len(self._live))

    def _answer_all(self) -> None:
        with self._changed:
            batch, self._pending = self._pending, []
        answers: Sequence[Answer] = [PolicyError("the policy gave no answer")] * len(batch)
        began = time.monotonic()
        try:
            answers = self._batching.answer([(pending.caller, pending.request) for pending in batch])
        finally:  # whatever the policy raises, no caller may wait forever
            with self._changed:
                for pending, answer in zip(batch, answers, strict=True):
                    pending.answer = answer
                self._busy, self._took = False, time.monotonic() - began
                self._changed.notify_all()


class ClientSession:
    """A connection with its rollout."""

    def __init__(self, policy: ServedPolicy, header: RolloutHeader, number: int) -> None:
        self._spec, self._policy, self._header, self._number = policy.spec, policy, header, number
        self._start: EpisodeStart | None = None
        self._begun = self._step = 0

    def expect(self, header: RolloutHeader) -> None:
        """End the rollout; the next observation begins another one."""
        self.end()
        self._header = header

    def act_on(self, message: Mapping[Any, Any], keys: ProfiledOptions) -> NDArray[np.float64]:
        """``act`` on an observation under such keys."""
        key_of = {"third_person": keys.image_key, "wrist": keys.wrist_key}
        needed = [*(key_of[camera.role] for camera in self._spec.cameras), keys.instruction_key]
        if missing := [key for key in needed if key not in message]:
            raise ValueError(f"no {missing[0]!r} in the observation, but {short(sorted(map(str, message)))}")
        *pictures, instruction = (message[key] for key in needed)
        return self.act(instruction, pictures, message.get(keys.state_key))

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
            start = EpisodeStart(f"served-{self._begun}", instruction, self._header.task, self._header.seed)
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
