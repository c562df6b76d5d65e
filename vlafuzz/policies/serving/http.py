"""OpenVLA's ``POST /act``, with a thread for each connection."""

import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from vlafuzz.policies.clients.openvla import ActOptions, decode, encode
from vlafuzz.policies.clients.wire import ROLLOUT, short
from vlafuzz.policies.serving.sessions import MAX_BYTES, ClientSession, ServedPolicy


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    block_on_close = False  # clients keep connections open
    request_queue_size = 128  # with the default of 5, the sixth simulator to start waits for a second

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A client that resets its connection is no error of ours."""
        if not isinstance(sys.exc_info()[1], OSError):
            super().handle_error(request, client_address)


@contextmanager
def listening(served: ServedPolicy, address: str, port: int) -> Iterator[int]:
    """Answer requests within the block; yields the port."""
    with _Server((address, port), type("Handler", (_Acting,), {"served": served})) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True)
        thread.start()
        try:
            yield server.server_port
        finally:
            server.shutdown()
            thread.join()


class _Acting(BaseHTTPRequestHandler):
    """A connection, which is one rollout."""

    served: ServedPolicy
    protocol_version = "HTTP/1.1"
    disable_nagle_algorithm = True
    timeout = 600.0  # seconds without a byte: a simulator may be slow between two requests
    _session: ClientSession | None = None

    def finish(self) -> None:
        if self._session:
            self._session.end()
        super().finish()

    def do_POST(self) -> None:
        """Answer an observation with an action, or with a list of actions."""
        try:
            actions = self._act(decode(self._body()))
            status, value = 200, actions[0] if len(actions) == 1 else list(actions)
        except (ValueError, TypeError) as error:
            status, value = 400, {"error": short(error)}
        except Exception as error:  # the client gets the policy's error, and the server keeps running
            status, value = 500, {"error": f"{type(error).__name__}: {short(error)}"}
        body = encode(value)
        self.send_response(status)
        self.send_header("Content-Type", "application/json")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *args: Any) -> None:
        """Log nothing."""

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
        others = {keys.image_key: message["full_image"]} if "full_image" in message else {}  # OpenVLA-OFT's
        return self._session.act_on(others | message, keys)
