"""What the clients of all model servers share: limits, error messages, retries, and checks of replies.

Replies are untrusted: their size, type and shape are checked before they are used.
"""

from __future__ import annotations

import json
import logging
import time
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from vlafuzz.errors import Cause, PolicyError, PrerequisiteError
from vlafuzz.policies.base import EpisodeStart

MAX_BYTES = 4 << 20  # of a reply; a hundred actions take 3 kB
OPENING = 10.0  # seconds for a connection to open
PAUSES = (0.5, 1.0)  # seconds before the second and the third attempt
CONNECTION: tuple[Cause, ...] = ("connect",)
UNANSWERED: tuple[Cause, ...] = (*CONNECTION, "timeout")
KINDS = "biuf"  # of arrays: boolean, integers, floating point
# Identifies the rollout of a connection, where the protocol cannot; only our own servers read it.
ROLLOUT = "Vlafuzz-Rollout"
LOG = logging.getLogger(__name__)  # one line per retry
T = TypeVar("T")


def failure(url: str, message: str, cause: Cause, hint: str | None = None) -> PolicyError:
    """A PolicyError that names the server."""
    return PolicyError(f"{url}: {message}", hint, cause)


def late(url: str, wait: float) -> PolicyError:
    """The error for a reply that did not come in time."""
    return failure(url, f"no reply within {wait:.3g} s", "timeout", "the option timeout=… waits longer")


def too_large(url: str) -> PolicyError:
    """The error for a reply above ``MAX_BYTES``."""
    return failure(url, f"a reply of more than {MAX_BYTES >> 20} MiB", "protocol")


def with_retries(attempt: Callable[[], T], causes: Collection[Cause] = CONNECTION) -> T:
    """The result of ``attempt``, which is repeated up to twice when it fails by one of the causes.

    The server must not keep state between attempts: retry the opening of a connection, a request to a
    stateless server, or a whole rollout.

    Raises:
        PolicyError: of the last attempt, or the first with another cause.
    """
    for pause in PAUSES:
        try:
            return attempt()
        except PolicyError as error:
            if error.cause not in causes:
                raise
            LOG.warning("%s; again in %g s", error, pause)
        time.sleep(pause)
    return attempt()


@contextmanager
def required(protocol: str, start: str) -> Iterator[None]:
    """Open the first connection in the block: without a server, nothing can be tested.

    ``start``: a hint on how to start a server.

    Raises:
        PrerequisiteError: no server answers.
    """
    try:
        yield
    except PolicyError as error:
        raise PrerequisiteError(f"no {protocol} server: {error.message}", hint=error.hint or start) from None


def rollout_header(start: EpisodeStart, sent: int = 0) -> dict[str, str]:
    """What our own server must know to answer exactly as the policy does in process.

    ``sent``: how many of the rollout's observations were sent before.
    """
    rollout = {"episode": start.episode, "task": start.task, "seed": start.seed, "asked": sent}
    return {ROLLOUT: json.dumps(rollout)}


def actions_of(reply: Mapping[Any, Any]) -> NDArray[np.float64]:
    """The ``actions`` of a reply as ``(steps, n)``; a single action ``(n,)`` becomes one step.

    Raises:
        ValueError: there are none, or they are not numbers.
    """
    if "actions" not in reply:
        raise ValueError(f"a reply without actions, but {short(sorted(map(str, reply)))}")
    return numbers(reply["actions"])


def numbers(value: object) -> NDArray[np.float64]:
    """Actions as ``(steps, n)``; a single action ``(n,)`` becomes one step.

    Raises:
        ValueError: they are not numbers.
    """
    actions = np.asarray(value)  # a ragged list raises ValueError
    if actions.dtype.kind not in "iuf":
        raise ValueError(f"actions that are no numbers: {short(value)}")
    return np.atleast_2d(actions.astype(np.float64))


def array_of(data: bytes, dtype: object, shape: Any) -> NDArray[Any]:
    """An array from its bytes.

    Raises:
        ValueError: it is not an array of numbers, or the size does not match.
        TypeError: there is no such dtype.
    """
    kind = np.dtype(dtype)  # type: ignore[call-overload]  # anything may have been sent: TypeError
    if kind.kind not in KINDS:
        raise ValueError(f"an array of {kind}")
    return np.frombuffer(data, kind).reshape(shape).copy()  # a writable one


def short(value: object) -> str:
    """A value as one line of at most 300 characters."""
    text = " ".join(str(value).split())
    return text if len(text) <= 300 else f"{text[:300]} …"
