"""An HTTP server of OpenVLA's ``POST /act``."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from vlafuzz.subjects.act import ActOptions
from vlafuzz.subjects.act_wire import decode, encode
from vlafuzz.subjects.base import SubjectSpec
from vlafuzz.subjects.serving.host import Guest, Host, told_by
from vlafuzz.subjects.wire import ROLLOUT, short

MOST_ASKED = 64 << 20  # bytes of an observation
SILENCE = 600.0  # seconds after which a client that says nothing is let go of


@contextmanager
def listening(host: Host, address: str, port: int) -> Iterator[int]:
    """The port on which requests are answered, a thread for every connection."""

    class Handler(_Handler):
        served = host

    server = _Server((address, port), Handler)
    thread = threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True)
    thread.start()
    try:
        yield server.server_port
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    block_on_close = False  # clients keep connections open
    request_queue_size = 128  # with the usual 5, the sixth of many simulators that start waits for a second


class _Handler(BaseHTTPRequestHandler):
    """A connection, which is a rollout."""

    served: Host
    protocol_version = "HTTP/1.1"
    disable_nagle_algorithm = True
    timeout = SILENCE

    def setup(self) -> None:
        super().setup()
        self._guest: Guest | None = None

    def finish(self) -> None:
        if self._guest:
            self._guest.end()
        super().finish()

    def do_POST(self) -> None:  # http.server's name
        """An observation; the reply is an action, or a list of them."""
        status, value = self._answer()
        body = encode(value)
        with suppress(OSError):  # it may be gone
            self.send_response(status)
            self.send_header("Content-Type", "application/json")
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

    def log_message(self, format: str, *args: Any) -> None:
        """Nobody reads it."""

    def _body(self) -> bytes:
        if self.path.partition("?")[0] != "/act":
            raise ValueError(f"no {self.path!r} here, only /act")
        length = int(self.headers.get("Content-Length", 0))
        if not 0 < length <= MOST_ASKED:
            self.close_connection = True
            raise ValueError(f"a body of {length} bytes, expected 1 to {MOST_ASKED}")
        return self.rfile.read(length)

    def _answer(self) -> tuple[int, object]:
        """Status and value."""
        try:
            message = decode(self._body())
            if isinstance(message, dict) and "encoded" in message:
                message = decode(message["encoded"])
            if self._guest is None:
                self._guest = self.served.guest(told_by(self.headers.get(ROLLOUT)))
            actions = _asked(self.served.spec, self._guest, message)
        except (ValueError, TypeError) as error:
            return 400, {"error": short(error)}
        except Exception as error:  # whatever a subject raises is told, and the server stays
            return 500, {"error": f"{type(error).__name__}: {short(error)}"}
        return 200, actions[0] if len(actions) == 1 else list(actions)


def _asked(spec: SubjectSpec, guest: Guest, told: Mapping[str, Any]) -> Any:
    if not isinstance(told, dict):
        raise ValueError(f"no observation, but {type(told).__name__}")
    keys = ActOptions()
    told = {keys.image_key: told.get("full_image"), **told}  # as OFT's clients call it
    named = {"third_person": keys.image_key, "wrist": keys.wrist_key}
    pictures = [told.get(named[camera.role]) for camera in spec.cameras]
    return guest.act(told.get(keys.instruction_key), pictures, told.get(keys.state_key))
