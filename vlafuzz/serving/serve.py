"""Serve a policy by a protocol, under a name by which vlafuzz reaches it."""

import errno
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import fields
from urllib.parse import urlencode

from vlafuzz.clients.remote import needed
from vlafuzz.errors import UsageError, suggestion
from vlafuzz.policies.base import ActionSpec, Policy, PolicySpec
from vlafuzz.serving.sessions import ServedPolicy

Listening = Callable[[ServedPolicy, str, int], AbstractContextManager[int]]
# Prefix and suffix of the name for every protocol, around host and port.
PROTOCOLS = {"vla-eval": ("vla-eval:ws", ""), "openpi": ("openpi:ws", ""), "http": ("http", "/act")}


@contextmanager
def serving(policy: Policy, protocol: str, address: str = "127.0.0.1", port: int = 0) -> Iterator[str]:
    """Serve a policy within the block; yields the name by which vlafuzz reaches it, with suitable options.

    Raises:
        UsageError: no such protocol, the port is taken, or the policy needs what no client can send.
        PrerequisiteError: a package must be installed.
    """
    listening = _listening(protocol)
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
    """The options that a client needs: all that differ from the defaults."""
    sizes = {camera.role: f"{camera.width}x{camera.height}" for camera in spec.cameras}
    options: dict[str, str | int | float] = {"camera": sizes.get("third_person", "0")}
    if "wrist" in sizes:
        options["wrist"] = 1
        if sizes["wrist"] != options["camera"] and protocol != "vla-eval":  # which has one size: we resize
            options["wrist_camera"] = sizes["wrist"]
    if spec.state:
        options["state"] = 1
    default = ActionSpec()
    for field in fields(ActionSpec):
        if getattr(spec.action, field.name) != getattr(default, field.name):
            options[field.name] = getattr(spec.action, field.name)
    return options | ({"deterministic": 1} if spec.deterministic else {})


def _listening(protocol: str) -> Listening:
    if protocol not in PROTOCOLS:
        raise UsageError(f"unknown protocol {protocol!r}", hint=suggestion(protocol, PROTOCOLS))
    if protocol == "http":
        from vlafuzz.serving import openvla

        return openvla.listening
    with needed(f"--protocol {protocol}"):
        from vlafuzz.serving import websockets
    talk = websockets.talk_openpi if protocol == "openpi" else websockets.talk_vla_eval
    return lambda served, address, port: websockets.listening(served, talk, address, port)
