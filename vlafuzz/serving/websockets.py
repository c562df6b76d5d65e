"""WebSocket servers: vla-eval's protocol and openpi's."""

from __future__ import annotations

import io
import logging
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from http import HTTPStatus
from typing import Any

import numpy as np
from PIL import Image
from websockets.exceptions import ConnectionClosed
from websockets.sync.server import ServerConnection, serve

from vlafuzz import __version__
from vlafuzz.clients import openpi_wire, vla_eval_wire
from vlafuzz.clients.layouts import OWN
from vlafuzz.clients.openpi import OpenPiOptions
from vlafuzz.clients.vla_eval import PROTOCOL_VERSION
from vlafuzz.clients.vla_eval_spec import declared_actions, declared_observations
from vlafuzz.clients.wire import ROLLOUT, array_of, short
from vlafuzz.policies.base import PolicySpec
from vlafuzz.serving.sessions import ClientSession, ServedPolicy, Told, told_by

MOST_ASKED = 64 << 20  # bytes of an observation
BROKEN = 1011  # of a WebSocket's end: internal error
LOG = logging.getLogger(__name__)
LOG.addHandler(logging.NullHandler())
Talk = Callable[[ServedPolicy, ServerConnection], None]


@contextmanager
def listening(served: ServedPolicy, talk: Talk, address: str, port: int) -> Iterator[int]:
    """The port on which every connection is talked with, in a thread of its own."""
    live: set[ServerConnection] = set()

    def session(connection: ServerConnection) -> None:
        live.add(connection)
        try:
            with suppress(ConnectionClosed):
                talk(served, connection)
        finally:
            live.discard(connection)

    server = serve(
        session,
        address,
        port,
        compression=None,
        max_size=MOST_ASKED,
        ping_interval=None,
        close_timeout=1.0,
        process_request=_health,
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


def _health(connection: ServerConnection, request: Any) -> Any:
    """Whether it is up: vla-eval asks at /health, openpi at /healthz; /config has nothing to set."""
    replies = {"/health": '{"status":"ok"}\n', "/healthz": "OK\n", "/config": "{}\n"}
    reply = replies.get(request.path.partition("?")[0])
    return None if reply is None else connection.respond(HTTPStatus.OK, reply)


def talk_openpi(served: ServedPolicy, connection: ServerConnection) -> None:
    """Speak first; then an answer to every observation. An error is text, and the end."""
    connection.send(openpi_wire.pack({"server": f"vlafuzz {__version__}", "policy": served.spec.name}))
    session: ClientSession | None = None
    try:
        session = served.session(
            told_by(connection.request.headers.get(ROLLOUT) if connection.request else None)
        )
        for frame in connection:
            if isinstance(frame, str):
                raise ValueError("text, expected a message in msgpack")
            actions = _asked_by_key(served.spec, session, openpi_wire.unpack(frame))
            connection.send(openpi_wire.pack({"actions": actions}))
    except ConnectionClosed:
        raise
    except Exception as error:  # whatever a policy raises is told, and the server stays
        connection.send(f"{type(error).__name__}: {short(error)}")
        connection.close(BROKEN)
    finally:
        if session:
            session.end()


def _asked_by_key(spec: PolicySpec, session: ClientSession, told: Mapping[Any, Any]) -> np.ndarray[Any, Any]:
    keys = OpenPiOptions()
    named = {"third_person": keys.image_key, "wrist": keys.wrist_key}
    wanted = [named[camera.role] for camera in spec.cameras]
    if missing := [key for key in [*wanted, keys.instruction_key] if key not in told]:
        raise ValueError(f"no {missing[0]!r} in the observation, but {short(sorted(map(str, told)))}")
    return session.act(told[keys.instruction_key], [told[key] for key in wanted], told.get(keys.state_key))


def talk_vla_eval(served: ServedPolicy, connection: ServerConnection) -> None:
    """A reply to every greeting and observation; an error is a message too, and the session goes on."""
    session = served.session(Told())
    try:
        for frame in connection:
            kind, payload, number = vla_eval_wire.unpack(frame)
            try:
                reply = _replied(served.spec, session, kind, payload)
            except Exception as error:  # whatever a policy raises is told, and the session goes on
                reply = "error", {"error": f"{kind}_failed: {type(error).__name__}: {short(error)}"}
            if reply:
                connection.send(vla_eval_wire.pack(*reply, number))
    except ValueError as error:  # no message at all
        connection.close(BROKEN, short(error)[:100])
    finally:
        session.end()


def _replied(
    spec: PolicySpec, session: ClientSession, kind: str, payload: Mapping[str, Any]
) -> tuple[str, Mapping[str, Any]] | None:
    if kind == "hello":
        return "hello", _hello(spec)
    if kind == "episode_start":
        session.expect(Told.model_validate(payload.get("task", {})))
    elif kind == "episode_end":
        session.end()
    elif kind == "observation":
        pictures = [_decoded(picture) for picture in payload.get("images", {}).values()]
        state = payload.get("states", payload.get("state"))
        actions = session.act(payload.get("task_description"), pictures, state)
        return "action", {"actions": actions if len(actions) > 1 else actions[0]}
    else:
        raise ValueError(f"unknown type {kind!r}")
    return None


def _hello(spec: PolicySpec) -> Mapping[str, Any]:
    """What is declared."""
    return {
        "harness_version": __version__,
        "protocol_version": PROTOCOL_VERSION,
        "model_server": f"vlafuzz {spec.name}",
        "capabilities": {},
        "observation_params": {
            "send_state": spec.state,
            "send_wrist_image": any(camera.role == "wrist" for camera in spec.cameras),
        },
        "action_spec": declared_actions(spec.action),
        "observation_spec": declared_observations(spec.cameras, OWN if spec.state else None),
    }


def _decoded(picture: Any) -> Any:
    """vla-eval's own client compresses pictures unless it is told not to."""
    if not isinstance(picture, dict) or "__image__" not in picture:
        return picture
    if picture.get("format") == "raw":
        return array_of(picture["data"], np.uint8, picture["shape"])
    return np.array(Image.open(io.BytesIO(picture["data"]), formats=("PNG", "JPEG")).convert("RGB"))
