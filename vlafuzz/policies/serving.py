"""Serves a policy of ours by vla-eval's protocol, under a name by which vlafuzz reaches it."""

import errno
import logging
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict
from http import HTTPStatus
from typing import Any
from urllib.parse import urlencode

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from pydantic import BaseModel
from websockets.exceptions import ConnectionClosed
from websockets.sync.server import ServerConnection, serve

from vlafuzz import __version__
from vlafuzz.common.arrays import Array, Picture
from vlafuzz.common.reading import array_of, decoded
from vlafuzz.errors import UsageError
from vlafuzz.policies.base import ActionSpec, CameraRequest, EpisodeStart, Observation, Policy, PolicySpec
from vlafuzz.policies.batching import Request, ServedPolicy
from vlafuzz.policies.clients.conventions import OWN
from vlafuzz.policies.clients.msgpack_wire import pack_vla_eval, unpack_vla_eval
from vlafuzz.policies.clients.options import CONVENTIONS
from vlafuzz.policies.clients.vla_eval import PICTURE, PROTOCOL_VERSION, UNDECLARED, declared_actions
from vlafuzz.policies.clients.wire import short

MAX_BYTES = 64 << 20  # of an observation
INTERNAL_ERROR = 1011  # close code of WebSockets
HEALTH = {"/health": '{"status":"ok"}\n', "/config": "{}\n"}  # of vla-eval
LOG = logging.getLogger(__name__)
LOG.addHandler(logging.NullHandler())


@contextmanager
def serving(policy: Policy, address: str = "127.0.0.1", port: int = 0) -> Iterator[str]:
    """Serve a policy within the block; yields the name by which vlafuzz reaches it, with suitable options.

    Raises:
        UsageError: the port is taken, or the policy needs what no client can send.
    """
    if policy.spec.privileged or policy.spec.silhouettes:
        what = "the simulator's state" if policy.spec.privileged else "outlines"
        hint = "serve one that takes pictures, proprioception and words, such as mini"
        raise UsageError(f"{policy.spec.name} cannot be served: it wants {what}", hint)
    with ExitStack() as stack:
        try:
            port = stack.enter_context(listening(ServedPolicy(policy), address, port))
        except OSError as error:
            taken = error.errno in (errno.EADDRINUSE, errno.EACCES)
            hint = "--port 0 takes any that is free" if taken else "--host: an address of this machine"
            raise UsageError(f"{address}:{port}: {error.strerror or error}", hint) from None
        host = f"[{address}]" if ":" in address else address
        yield f"vla-eval:ws://{host}:{port}?{urlencode(options_of(policy.spec))}"


def options_of(spec: PolicySpec) -> dict[str, str | int | float]:
    """The options that a client needs: what differs from the defaults, and all it would have to guess."""
    sizes = {camera.role: f"{camera.width}x{camera.height}" for camera in spec.cameras}
    options: dict[str, str | int | float] = {"camera": sizes.get("third_person", "0")}
    if "wrist" in sizes:  # of the same size: what is served resizes it
        options["wrist"] = 1
    if spec.state:
        options["state"] = 1
    default = asdict(ActionSpec())
    conventions = {"action": "eef_delta", "frame": "base"} | asdict(spec.action)
    declared = declared_actions(spec.action)
    guessed = CONVENTIONS.keys() - {name for name, of in declared.items() if of["format"] != UNDECLARED}
    options |= {
        name: f"{value:.12g}" if isinstance(value, float) else value
        for name, value in conventions.items()
        if name in guessed or value != default.get(name, value)
    }
    return options | ({"deterministic": 1} if spec.deterministic else {})


@contextmanager
def listening(served: ServedPolicy, address: str, port: int) -> Iterator[int]:
    """Answer connections within the block, with a thread for each; yields the port."""
    live: set[ServerConnection] = set()

    def session(connection: ServerConnection) -> None:
        live.add(connection)
        try:
            with suppress(ConnectionClosed):
                _talk(served, connection)
        finally:
            live.discard(connection)

    def health(connection: ServerConnection, request: Any) -> Any:
        reply = HEALTH.get(request.path.partition("?")[0])
        return None if reply is None else connection.respond(HTTPStatus.OK, reply)

    server = serve(
        session,
        address,
        port,
        compression=None,
        max_size=MAX_BYTES,
        ping_interval=None,
        close_timeout=1.0,
        process_request=health,
        logger=LOG,
    )
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield int(server.socket.getsockname()[1])
    finally:
        server.shutdown()
        for connection in list(live):
            connection.close()
        thread.join()


def _talk(served: ServedPolicy, connection: ServerConnection) -> None:
    """Reply to every greeting and observation. An error is sent as a message, and the session goes on."""
    session = _Session(served)
    try:
        for frame in connection:
            kind, payload, number = unpack_vla_eval(frame)
            try:
                reply = session.reply(kind, payload)
            except Exception as error:  # the client gets the policy's error, and the session goes on
                reply = "error", {"error": f"{kind}_failed: {type(error).__name__}: {short(error)}"}
            if reply:
                connection.send(pack_vla_eval(*reply, number))
    except ValueError as error:  # the frame is no message
        connection.close(INTERNAL_ERROR, short(error)[:100])
    finally:
        session.end()


class _Begun(BaseModel, frozen=True):
    """What a client says when a rollout begins."""

    task: str = ""
    seed: int = 0


class _Session:
    def __init__(self, policy: ServedPolicy) -> None:
        self._spec, self._policy, self._number = policy.spec, policy, next(policy.newcomers)
        self._said = _Begun()
        self._start: EpisodeStart | None = None
        self._begun = self._step = 0

    def reply(self, kind: str, payload: Mapping[str, Any]) -> tuple[str, Mapping[str, Any]] | None:
        """Kind and content of the answer to a message, if it needs one; ValueError for one that makes no sense."""
        spec = self._spec
        if kind == "hello":
            wrist = any(camera.role == "wrist" for camera in spec.cameras)
            observed = [(camera.name, 0, PICTURE) for camera in spec.cameras]
            observed += [("state", 7, OWN)] * spec.state + [("language", 0, "language")]
            return kind, {
                "harness_version": __version__,
                "protocol_version": PROTOCOL_VERSION,
                "model_server": f"vlafuzz {spec.name}",
                "capabilities": {},
                "observation_params": {"send_state": spec.state, "send_wrist_image": wrist},
                "action_spec": declared_actions(spec.action),
                "observation_spec": {name: {"name": name, "dims": dims, "format": of} for name, dims, of in observed},
            }
        if kind == "episode_start":
            self.end()
            self._said = _Begun.model_validate(payload.get("task", {}))
        elif kind == "episode_end":
            self.end()
        elif kind == "observation":
            pictures = [_picture(picture) for picture in payload.get("images", {}).values()]
            state = payload.get("states", payload.get("state"))
            actions = self._act(payload.get("task_description"), pictures, state)
            return "action", {"actions": actions if len(actions) > 1 else actions[0]}
        else:
            raise ValueError(f"unknown type {kind!r}")
        return None

    def end(self) -> None:
        """End the rollout, whatever its outcome."""
        if self._start is not None:
            self._policy.ask(self._number, Request(over=[self._start.episode]))
        self._start = None

    def _act(self, instruction: object, pictures: Sequence[object], state: object) -> Array:
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


def _picture(sent: Any) -> Any:
    """A picture as an array: vla-eval's own client compresses pictures by default."""
    if not isinstance(sent, dict) or "__image__" not in sent:
        return sent
    if sent.get("format") == "raw":
        return array_of(sent["data"], np.uint8, sent["shape"])
    return np.array(decoded(sent["data"], "PNG", "JPEG").convert("RGB"))


def _fitting(picture: Any, camera: CameraRequest) -> Picture:
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
        expected = "expected 7 numbers: position, rotation vector, opening"
        raise ValueError(f"proprioception of shape {state.shape}, {expected}")
    return state.astype(np.float32)
