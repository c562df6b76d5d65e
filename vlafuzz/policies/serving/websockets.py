"""A WebSocket server of vla-eval's protocol."""

import logging
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from http import HTTPStatus
from typing import Any

import numpy as np
from websockets.exceptions import ConnectionClosed
from websockets.sync.server import ServerConnection, serve

from vlafuzz import __version__
from vlafuzz.common.reading import array_of, decoded
from vlafuzz.policies.batching import ServedPolicy
from vlafuzz.policies.clients.conventions import OWN
from vlafuzz.policies.clients.msgpack_wire import pack_vla_eval, unpack_vla_eval
from vlafuzz.policies.clients.vla_eval import PICTURE, PROTOCOL_VERSION, declared_actions
from vlafuzz.policies.clients.wire import short
from vlafuzz.policies.serving.sessions import MAX_BYTES, ClientSession

INTERNAL_ERROR = 1011  # close code of WebSockets
HEALTH = {"/health": '{"status":"ok"}\n', "/config": "{}\n"}  # of vla-eval
LOG = logging.getLogger(__name__)
LOG.addHandler(logging.NullHandler())


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
    session = ClientSession(served)
    try:
        for frame in connection:
            kind, payload, number = unpack_vla_eval(frame)
            try:
                reply = _reply(served, session, kind, payload)
            except Exception as error:  # the client gets the policy's error, and the session goes on
                reply = "error", {"error": f"{kind}_failed: {type(error).__name__}: {short(error)}"}
            if reply:
                connection.send(pack_vla_eval(*reply, number))
    except ValueError as error:  # the frame is no message
        connection.close(INTERNAL_ERROR, short(error)[:100])
    finally:
        session.end()


def _reply(
    served: ServedPolicy, session: ClientSession, kind: str, payload: Mapping[str, Any]
) -> tuple[str, Mapping[str, Any]] | None:
    spec = served.spec
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
            "observation_spec": {name: {"name": name, "dims": dims, "format": kind} for name, dims, kind in observed},
        }
    if kind == "episode_start":
        session.begin(payload.get("task", {}))
    elif kind == "episode_end":
        session.end()
    elif kind == "observation":
        pictures = [_picture(picture) for picture in payload.get("images", {}).values()]
        state = payload.get("states", payload.get("state"))
        actions = session.act(payload.get("task_description"), pictures, state)
        return "action", {"actions": actions if len(actions) > 1 else actions[0]}
    else:
        raise ValueError(f"unknown type {kind!r}")
    return None


def _picture(sent: Any) -> Any:
    """A picture as an array: vla-eval's own client compresses pictures by default."""
    if not isinstance(sent, dict) or "__image__" not in sent:
        return sent
    if sent.get("format") == "raw":
        return array_of(sent["data"], np.uint8, sent["shape"])
    return np.array(decoded(sent["data"], "PNG", "JPEG").convert("RGB"))
