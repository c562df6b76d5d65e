"""Serve a policy: choose the protocol, and say under which name it is found."""

from __future__ import annotations

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
# What each protocol's names begin and end with, around host and port.
PROTOCOLS = {"vla-eval": ("vla-eval:ws", ""), "openpi": ("openpi:ws", ""), "http": ("http", "/act")}


@contextmanager
def serving(policy: Policy, protocol: str, address: str = "127.0.0.1", port: int = 0) -> Iterator[str]:
    """The name under which vlafuzz finds a policy that is being served, with the options that fit it.

    Raises:
        UsageError: no such protocol, the port is taken, or the policy needs what no client can send.
        PrerequisiteError: a package to install.
    """
    listening = _listening(protocol)
    served = ServedPolicy(policy)
    with ExitStack() as stack:
        try:
            found = stack.enter_context(listening(served, address, port))
        except OSError as error:
            taken = error.errno in (errno.EADDRINUSE, errno.EACCES)
            hint = "--port 0 takes any that is free" if taken else "--host: an address of this machine"
            raise UsageError(f"{address}:{port}: {error.strerror or error}", hint) from None
        begins, ends = PROTOCOLS[protocol]
        where = f"[{address}]" if ":" in address else address
        yield f"{begins}://{where}:{found}{ends}?{urlencode(options_of(policy.spec, protocol))}"


def options_of(spec: PolicySpec, protocol: str) -> dict[str, str | int | float]:
    """What a client has to be told: whatever is not the default."""
    sizes = {camera.role: f"{camera.width}x{camera.height}" for camera in spec.cameras}
    told: dict[str, str | int | float] = {"camera": sizes.get("third_person", "0")}
    if "wrist" in sizes:
        told["wrist"] = 1
        if sizes["wrist"] != told["camera"] and protocol != "vla-eval":  # which has one size: we resize
            told["wrist_camera"] = sizes["wrist"]
    if spec.state:
        told["state"] = 1
    usual = ActionSpec()
    for field in fields(ActionSpec):
        if getattr(spec.action, field.name) != getattr(usual, field.name):
            told[field.name] = getattr(spec.action, field.name)
    return told | ({"deterministic": 1} if spec.deterministic else {})


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
