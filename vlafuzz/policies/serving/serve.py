"""Serve a policy by a protocol, under a name by which vlafuzz reaches it."""

import errno
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import asdict
from functools import partial
from urllib.parse import urlencode

from vlafuzz.errors import UsageError, suggestion
from vlafuzz.policies.base import ActionSpec, Policy, PolicySpec
from vlafuzz.policies.clients.options import CONVENTIONS
from vlafuzz.policies.clients.servers import needed
from vlafuzz.policies.clients.vla_eval import UNDECLARED, declared_actions
from vlafuzz.policies.serving.sessions import ServedPolicy

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
    listening: Callable[[ServedPolicy, str, int], AbstractContextManager[int]]
    if protocol == "http":
        from vlafuzz.policies.serving import http

        listening = http.listening
    else:
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
