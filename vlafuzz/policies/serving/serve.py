"""Serve a policy by a protocol, under a name by which vlafuzz reaches it; OpenVLA's ``POST /act`` itself."""

import errno
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import asdict
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import urlencode

from vlafuzz.errors import UsageError, suggestion
from vlafuzz.policies.base import ActionSpec, Policy, PolicySpec
from vlafuzz.policies.clients.openvla import ActOptions, decode, encode
from vlafuzz.policies.clients.options import CONVENTIONS
from vlafuzz.policies.clients.servers import needed
from vlafuzz.policies.clients.vla_eval import UNDECLARED, declared_actions
from vlafuzz.policies.clients.wire import ROLLOUT, short
from vlafuzz.policies.serving.sessions import MAX_BYTES, ClientSession, ServedPolicy

# Prefix and suffix of the name for every protocol, around host and port.
PROTOCOLS = {"vla-eval": ("vla-eval:ws", ""), "openpi": ("openpi:ws", ""), "http": ("http", "/act")}


@contextmanager
def serving(policy: Policy, protocol: str, address: str = "127.0.0.1", port: int = 0) -> Iterator[str]:
    """Serve a policy within the block; yields the name by which vlafuzz reaches it, with suitable options.

    Raises:
        UsageError: no such protocol, the port is taken, or the policy needs what no client can send.
        PrerequisiteError: a package must be installed.
    """
    if protocol not in PROTOCOLS:
        raise UsageError(f"unknown protocol {protocol!r}", hint=suggestion(protocol, PROTOCOLS))
    listening: Callable[[ServedPolicy, str, int], AbstractContextManager[int]] = _acting
    if protocol != "http":
        with needed(f"--protocol {protocol}"):
            from vlafuzz.policies.serving import websockets
        talk = websockets.talk_openpi if protocol == "openpi" else websockets.talk_vla_eval
        listening = partial(websockets.listening, talk)
    served = ServedPolicy(policy)
    with ExitStack() as stack:
        try:
            port = stack.enter_context(listening(served, address, port))
        except OSError as error:
            taken = error.errno in (errno.EADDRINUSE, errno.EACCES)
            hint = "--port 0 takes any that is free" if taken else "--host: an address of this machine"
            raise UsageError(f"{address}:{port}: {error.strerror or error}", hint) from None
        prefix, suffix = PROTOCOLS[protocol]
        host = f"[{address}]" if ":" in address else address
        yield f"{prefix}://{host}:{port}{suffix}?{urlencode(options_of(policy.spec, protocol))}"


def options_of(spec: PolicySpec, protocol: str) -> dict[str, str | int | float]:
    """The options that a client needs: what differs from the defaults, and all it would have to guess."""
    sizes = {camera.role: f"{camera.width}x{camera.height}" for camera in spec.cameras}
    options: dict[str, str | int | float] = {"camera": sizes.get("third_person", "0")}
    if "wrist" in sizes:
        options["wrist"] = 1
        if sizes["wrist"] != options["camera"] and protocol != "vla-eval":  # which has one size: we resize
            options["wrist_camera"] = sizes["wrist"]
    if spec.state:
        options["state"] = 1
    default = asdict(ActionSpec())
    conventions = {"action": "eef_delta", "frame": "base"} | asdict(spec.action)
    declared = declared_actions(spec.action) if protocol == "vla-eval" else {}
    guessed = CONVENTIONS.keys() - {name for name, of in declared.items() if of["format"] != UNDECLARED}
    options |= {
        name: f"{value:.12g}" if isinstance(value, float) else value
        for name, value in conventions.items()
        if name in guessed or value != default.get(name, value)
    }
    return options | ({"deterministic": 1} if spec.deterministic else {})


def says_of(spec: PolicySpec) -> str:
    """What decides how fast a served policy is tested: its batches and its chunks, as a sentence."""
    batch = f"up to {spec.max_batch} observations" if spec.max_batch > 1 else "one observation"
    some = {None: "all actions", 1: "the first action"}.get(spec.execute, f"the first {spec.execute} actions")
    of_chunk = f"{some} of each chunk {'is' if spec.execute == 1 else 'are'} executed"
    once = "at once" if spec.max_batch > 1 else "at a time"
    return f"it answers {batch} {once}, and {of_chunk} (max_batch and execute of its PolicySpec)"


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    block_on_close = False  # clients keep connections open
    request_queue_size = 128  # with the default of 5, the sixth simulator to start waits for a second

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A client that resets its connection is no error of ours."""
        if not isinstance(sys.exc_info()[1], OSError):
            super().handle_error(request, client_address)


@contextmanager
def _acting(served: ServedPolicy, address: str, port: int) -> Iterator[int]:
    """Answer requests of /act within the block, with a thread for each connection; yields the port."""
    with _Server((address, port), type("Handler", (_Handler,), {"served": served})) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True)
        thread.start()
        try:
            yield server.server_port
        finally:
            server.shutdown()
            thread.join()


class _Handler(BaseHTTPRequestHandler):
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
