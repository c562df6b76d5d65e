"""HTTP server for OpenVLA's ``POST /act``."""

import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from vlafuzz.policies.base import PolicySpec
from vlafuzz.policies.clients.openvla import ActOptions, decode, encode
from vlafuzz.policies.clients.wire import ROLLOUT, short
from vlafuzz.policies.serving.http import BoundedHandler, BoundedServer
from vlafuzz.policies.serving.sessions import ClientSession, ServedPolicy

MAX_BYTES = 64 << 20  # of an observation
SILENCE = 600.0  # seconds between two requests of a rollout: its simulator may be slow


@contextmanager
def listening(served: ServedPolicy, address: str, port: int) -> Iterator[int]:
    """Answer requests within the block, with a thread per connection; yields the port."""
    handler = type("Handler", (_Handler,), {"served": served})
    server = BoundedServer((address, port), handler)
    thread = threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True)
    thread.start()
    try:
        yield server.server_port
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


class _Handler(BoundedHandler):
    """A connection, which is one rollout."""

    served: ServedPolicy
    silence = SILENCE

    def setup(self) -> None:
        super().setup()
        self._session: ClientSession | None = None

    def finish(self) -> None:
        if self._session:
            self._session.end()
        super().finish()

    def do_POST(self) -> None:  # noqa: N802 - http.server's name
        """Answer an observation with an action, or with a list of actions."""
        status, value = self._value()
        self.answer(status, "application/json", encode(value))

    def _body(self) -> bytes:
        if self.path.partition("?")[0] != "/act":
            raise ValueError(f"no {self.path!r} here, only /act")
        length = int(self.headers.get("Content-Length", 0))
        if not 0 < length <= MAX_BYTES:
            self.close_connection = True
            raise ValueError(f"a body of {length} bytes, expected 1 to {MAX_BYTES}")
        return self.rfile.read(length)

    def _value(self) -> tuple[int, object]:
        try:
            message = decode(self._body())
            if isinstance(message, dict) and "encoded" in message:
                message = decode(message["encoded"])
            if self._session is None:
                self._session = self.served.session(self.headers.get(ROLLOUT))
            actions = _act(self.served.spec, self._session, message)
        except (ValueError, TypeError) as error:
            return 400, {"error": short(error)}
        except Exception as error:  # the client gets the policy's error, and the server keeps running
            return 500, {"error": f"{type(error).__name__}: {short(error)}"}
        return 200, actions[0] if len(actions) == 1 else list(actions)


def _act(spec: PolicySpec, session: ClientSession, message: Mapping[str, Any]) -> Any:
    if not isinstance(message, dict):
        raise ValueError(f"no observation, but {type(message).__name__}")
    keys = ActOptions()
    message = {keys.image_key: message.get("full_image"), **message}  # the key of OFT's clients
    key_of = {"third_person": keys.image_key, "wrist": keys.wrist_key}
    pictures = [message.get(key_of[camera.role]) for camera in spec.cameras]
    return session.act(message.get(keys.instruction_key), pictures, message.get(keys.state_key))
