"""Serve a policy by vla-eval's protocol, under a name by which vlafuzz reaches it."""

import errno
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict
from urllib.parse import urlencode

from vlafuzz.errors import UsageError
from vlafuzz.policies.base import ActionSpec, Policy, PolicySpec
from vlafuzz.policies.batching import ServedPolicy
from vlafuzz.policies.clients.options import CONVENTIONS
from vlafuzz.policies.clients.servers import needed
from vlafuzz.policies.clients.vla_eval import UNDECLARED, declared_actions


@contextmanager
def serving(policy: Policy, address: str = "127.0.0.1", port: int = 0) -> Iterator[str]:
    """Serve a policy within the block; yields the name by which vlafuzz reaches it, with suitable options.

    Raises:
        UsageError: the port is taken, or the policy needs what no client can send.
        PrerequisiteError: a package must be installed.
    """
    with needed("vlafuzz serve"):
        from vlafuzz.policies.serving.websockets import listening
    if policy.spec.privileged or policy.spec.silhouettes:
        what = "the simulator's state" if policy.spec.privileged else "outlines"
        hint = "serve one that takes pictures, proprioception and words, such as mini"
        raise UsageError(f"{policy.spec.name} cannot be served: it wants {what}", hint)
    with ExitStack() as stack:
        try:
            port = stack.enter_context(listening(ServedPolicy(policy), address, port))
        except OSError as error:
            taken = error.errno in (errno.EADDRINUSE, errno.EACCES)
            hint = "--port 0 takes any that is free" if taken else "--host: an address of this machine"
            raise UsageError(f"{address}:{port}: {error.strerror or error}", hint) from None
        host = f"[{address}]" if ":" in address else address
        yield f"vla-eval:ws://{host}:{port}?{urlencode(options_of(policy.spec))}"


def options_of(spec: PolicySpec) -> dict[str, str | int | float]:
    """The options that a client needs: what differs from the defaults, and all it would have to guess."""
    sizes = {camera.role: f"{camera.width}x{camera.height}" for camera in spec.cameras}
    options: dict[str, str | int | float] = {"camera": sizes.get("third_person", "0")}
    if "wrist" in sizes:  # of the same size: what is served resizes it
        options["wrist"] = 1
    if spec.state:
        options["state"] = 1
    default = asdict(ActionSpec())
    conventions = {"action": "eef_delta", "frame": "base"} | asdict(spec.action)
    declared = declared_actions(spec.action)
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
