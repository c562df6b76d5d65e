"""HTTP server for OpenVLA's ``POST /act``."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from vlafuzz.policies.clients.openvla import ActOptions, decode, encode
from vlafuzz.policies.clients.wire import ROLLOUT, short
from vlafuzz.policies.serving.http import BoundedHandler, BoundedServer
from vlafuzz.policies.serving.sessions import MAX_BYTES, ClientSession, ServedPolicy

SILENCE = 600.0  # seconds between two requests of a rollout: its simulator may be slow


@contextmanager
def listening(served: ServedPolicy, address: str, port: int) -> Iterator[int]:
    """Answer requests within the block, with a thread per connection; yields the port."""
    server = BoundedServer((address, port), type("Handler", (_Handler,), {"served": served}))
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
    _session: ClientSession | None = None

    def finish(self) -> None:
        if self._session:
            self._session.end()
        super().finish()

    def do_POST(self) -> None:  # noqa: N802 - http.server's name
        """Answer an observation with an action, or with a list of actions."""
        try:
            actions = self._act(decode(self._body()))
            status, value = 200, actions[0] if len(actions) == 1 else list(actions)
        except (ValueError, TypeError) as error:
            status, value = 400, {"error": short(error)}
        except Exception as error:  # the client gets the policy's error, and the server keeps running
            status, value = 500, {"error": f"{type(error).__name__}: {short(error)}"}
        self.answer(status, "application/json", encode(value))

    def _body(self) -> bytes:
        if self.path.partition("?")[0] != "/act":
            raise ValueError(f"no {self.path!r} here, only /act")
        length = int(self.headers.get("Content-Length", 0))
        if not 0 < length <= MAX_BYTES:
            self.close_connection = True
            raise ValueError(f"a body of {length} bytes, expected 1 to {MAX_BYTES}")
        return self.rfile.read(length)

    def _act(self, message: Any) -> Any:
        if isinstance(message, dict) and "encoded" in message:
            message = decode(message["encoded"])
        if self._session is None:
            self._session = self.served.session(self.headers.get(ROLLOUT))
        if not isinstance(message, dict):
            raise ValueError(f"no observation, but {type(message).__name__}")
        keys = ActOptions()
        return self._session.act_on({keys.image_key: message.get("full_image"), **message}, keys)
