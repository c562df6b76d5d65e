"""Policies behind the real vla-eval server, and servers that misbehave."""

import re
import socket
import threading
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from typing import Any

import msgpack
import numpy as np
import pytest
from vla_eval import serve_background
from vla_eval.model_servers.predict import PredictModelServer
from vla_eval.specs import DimSpec
from websockets.protocol import State
from websockets.sync.server import serve

from tests.doubles import Idle
from tests.worlds.tabletop.sim.scenes import evaluate, pick_up, put
from vlafuzz.errors import PolicyError
from vlafuzz.model import Verdict
from vlafuzz.policies.base import ActionChunk, CameraRequest, EpisodeStart, Observation, Policy, PolicySpec
from vlafuzz.rollouts.policies import make_policy

STATE = np.array([0.1, -0.2, 0.3, 3.0, 0.5, 0.0, 0.5], dtype=np.float32)
GRIPPERS = {
    "open_positive": "binary_close_negative",
    "close_positive": "binary_close_positive",
    "open_01": "continuous_01",
    "close_01": "binary_close_01",
}


class Served(PredictModelServer):
    """A policy that needs only pictures, proprioception and words, as a vla-eval model server.

    ``more`` goes to the real server: ``chunk_size``, ``max_batch_size``, … It keeps all requests.
    """

    def __init__(self, policy: Policy, **more: Any) -> None:
        super().__init__(**more)
        self.policy, self._lock = policy, threading.Lock()
        self.started: list[EpisodeStart] = []
        self.ended: list[str] = []
        self.suites: list[str] = []
        self.seen: list[dict[str, Any]] = []
        self.batches: list[int] = []

    async def on_episode_start(self, config: dict[str, Any], ctx: Any) -> None:
        await super().on_episode_start(config, ctx)
        task = config["task"]
        with self._lock:
            self.suites.append(task["suite"])
            self.started.append(EpisodeStart(task["episode"], task["name"], task["task"], task["seed"]))
            self.policy.reset([EpisodeStart(ctx.session_id, task["name"], task["task"], task["seed"])])

    async def on_episode_end(self, result: dict[str, Any], ctx: Any) -> None:
        await super().on_episode_end(result, ctx)
        self.ended.append(ctx.session_id)

    def predict_batch(self, obs_batch: list[dict[str, Any]], ctx_batch: list[Any]) -> list[dict[str, Any]]:
        with self._lock:
            self.seen += obs_batch
            self.batches.append(len(obs_batch))
            pairs = zip(obs_batch, ctx_batch, strict=True)
            chunks = self.policy.act([self._observation(message, ctx) for message, ctx in pairs])
        return [{"actions": chunk.actions} for chunk in chunks]

    def _observation(self, message: dict[str, Any], ctx: Any) -> Observation:
        names = [camera.name for camera in self.policy.spec.cameras]
        images = dict(zip(names, message["images"].values(), strict=True))
        state, said = message.get("state"), message["task_description"]
        return Observation(ctx.session_id, ctx.step, said, images=images, state=state)

    def get_action_spec(self) -> dict[str, DimSpec]:
        action = self.policy.spec.action
        return {
            "position": DimSpec("position", 3, "delta_xyz"),
            "rotation": DimSpec("rotation", 3, {"rpy": "euler_xyz"}.get(action.rotation, action.rotation)),
            "gripper": DimSpec("gripper", 1, GRIPPERS[action.gripper]),
        }

    def get_observation_spec(self) -> dict[str, DimSpec]:
        spec = self.policy.spec
        pictures = {camera.name: DimSpec(camera.name, 0, "rgb_hwc_uint8") for camera in spec.cameras}
        state = {"state": DimSpec("state", 7, "raw")} if spec.state else {}
        return {**pictures, **state, "language": DimSpec("language", 0, "language")}


@contextmanager
def serving(server: PredictModelServer | Policy, **more: Any) -> Iterator[str]:
    """The name by which vlafuzz reaches it, without options."""
    served = server if isinstance(server, PredictModelServer) else Served(server, **more)
    with serve_background(served) as handle:
        yield f"vla-eval:{handle.url}"
    for stream in (served._send_stream, served._receive_stream):  # of its batches; it leaves them open
        if stream is not None:
            stream.close()


class Rounded:
    """A policy whose actions are rounded to 32 bits, like a server's."""

    def __init__(self, policy: Policy) -> None:
        self._policy, self.spec = policy, policy.spec
        self.reset, self.close = policy.reset, policy.close

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        chunks = self._policy.act(observations)
        return [ActionChunk(chunk.actions.astype(np.float32).astype(np.float64)) for chunk in chunks]


class Attentive(Idle):
    """Moves as a function of instruction, proprioception, pictures and steps so far, 3 steps at a time."""

    def __init__(self, *cameras: CameraRequest, **more: Any) -> None:
        self.spec = PolicySpec("attentive", cameras=cameras, state=True, **{"execute": None} | more)
        self._calls: dict[str, int] = {}

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        self._calls |= {start.episode: start.seed for start in episodes}

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        return [ActionChunk(self._decide(seen)) for seen in observations]

    def _decide(self, seen: Observation) -> np.ndarray:
        self._calls[seen.episode] += 1
        known = [zlib.crc32(seen.instruction.encode()), self._calls[seen.episode]]
        known += [zlib.crc32(picture.tobytes()) for picture in seen.images.values()]
        rng = np.random.default_rng([*known, *np.abs(seen.state * 1e6).astype(int)])
        moves = rng.uniform(-1, 1, (3, 7)) * [0.03, 0.03, 0.01, 0.1, 0.1, 0.1, 1]
        return (moves - [0, 0, 0.02, 0, 0, 0, 0]).astype(np.float32).astype(np.float64)


class Answering(PredictModelServer):
    """The real server with a model that answers by a function of the observation."""

    def __init__(self, answer: Callable[[dict[str, Any]], Any], **declared: Any) -> None:
        super().__init__()
        self._answer, self._declared = answer, declared

    def predict(self, obs: dict[str, Any], ctx: Any) -> dict[str, Any]:
        return {"actions": self._answer(obs)}

    def get_observation_params(self) -> dict[str, Any]:
        return self._declared.get("params", {})

    def get_action_spec(self) -> dict[str, DimSpec]:
        return {name: DimSpec(name, 0, kind) for name, kind in self._declared.get("action", {}).items()}

    def get_observation_spec(self) -> dict[str, DimSpec]:
        return {name: DimSpec(name, 0, kind) for name, kind in self._declared.get("observation", {}).items()}


@contextmanager
def websocket(session: Callable[[Any], None], **options: Any) -> Iterator[int]:
    """The port of a server of WebSockets."""
    options = {"compression": None, "max_size": None, "close_timeout": 1} | options
    server = serve(session, "127.0.0.1", 0, **options)
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    try:
        yield int(server.socket.getsockname()[1])
    finally:
        server.shutdown()
        thread.join()


HELLO = {"protocol_version": 1, "harness_version": "0", "model_server": "Scripted"}
CLOSE, HANG = object(), object()


@contextmanager
def scripted(*replies: Any, hello: Any = HELLO) -> Iterator[str]:
    """Our own server, with scripted replies to the observations of a session.

    A reply is bytes or text as they are, a function of the observation's number, or ``CLOSE`` or ``HANG``.
    """
    left = list(replies)

    def session(connection: Any) -> None:
        for frame in connection:
            received = msgpack.unpackb(frame)
            if received["type"] == "hello":
                reply(connection, received["seq"], lambda number: message("hello", hello, number))
            elif received["type"] == "observation":
                reply(connection, received["seq"], left.pop(0))

    def reply(connection: Any, number: int, answer: Any) -> None:
        if answer is CLOSE:
            connection.socket.shutdown(socket.SHUT_RDWR)
        elif answer is HANG:
            threading.Event().wait(1.5)
        else:
            connection.send(answer(number) if callable(answer) else answer)

    with websocket(session, max_queue=1) as port:
        yield f"vla-eval:ws://127.0.0.1:{port}"


def message(kind: str, payload: Any, number: int) -> bytes:
    return msgpack.packb({"type": kind, "payload": payload, "seq": number, "timestamp": 0.0})


def start(name: str, seed: int = 0) -> EpisodeStart:
    return EpisodeStart(name, "pick up apple", "pick-up", seed)


def seen(episode: str, step: int = 0, **more: object) -> Observation:
    return Observation(episode, step, "pick up apple", state=STATE, **more)


def black(spec: PolicySpec) -> dict[str, np.ndarray]:
    return {camera.name: np.zeros((camera.height, camera.width, 3), np.uint8) for camera in spec.cameras}


def asked(name: str, **more: object) -> list[list[float]]:
    """The actions for the first observation of a rollout; ``more``: of the observation."""
    with closing(make_policy(name)) as policy:
        policy.reset([start("one")])
        (chunk,) = policy.act([seen("one", **{"images": black(policy.spec)} | more)])
    return chunk.actions.tolist()


def failure(name: str, **more: object) -> PolicyError:
    """The error of that."""
    with pytest.raises(PolicyError) as caught:
        asked(name, **more)
    return caught.value


def check_failure(error: PolicyError, cause: str, says: str) -> None:
    """An error has its cause, and a short message."""
    assert (error.cause, bool(re.search(says, error.message))) == (cause, True), error.message
    assert len(error.message) < 800


def still_open(opened) -> int:
    return sum(connection.state is not State.CLOSED for connection in opened)


def check_same_as_in_process(name: str, make: Callable[[], Policy], verdict: Verdict) -> None:
    """Whole rollouts of a policy behind a server have the verdict, and the actions and states of those without."""
    scenes = [pick_up(put("coke_can", -0.05, 0.1)), pick_up(put("green_cube", 0.05, -0.15, 30.0))]
    for far, near in zip(evaluate(make_policy(name), *scenes), evaluate(make(), *scenes), strict=True):
        assert verdict is far.verdict is near.verdict, far.detail
        assert np.array_equal(far.rollouts[0].actions, near.rollouts[0].actions)
        assert far.rollouts[0].states_hash == near.rollouts[0].states_hash
