"""What the clients of all model servers share: limits, numbers from outside, new attempts, who is to blame.

Replies come from outside: each is checked for size, type and shape before it is used.
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

MOST_BYTES = 4 << 20  # of a reply; a hundred actions are 3 kB
OPENING = 10.0  # seconds for a connection to open
PAUSES = (0.5, 1.0)  # seconds before the second attempt, and before the third
CONNECTION: tuple[Cause, ...] = ("connect",)
UNANSWERED: tuple[Cause, ...] = (*CONNECTION, "timeout")
KINDS = "biuf"  # of arrays: boolean, integers, floating point
# Which rollout a connection is for, where the protocol has no word for it. Other servers than ours ignore it.
ROLLOUT = "Vlafuzz-Rollout"
LOG = logging.getLogger(__name__)  # a line for every new attempt
Done = TypeVar("Done")


def failure(url: str, told: str, cause: Cause, hint: str | None = None) -> PolicyError:
    """The policy's error, with where it is."""
    return PolicyError(f"{url}: {told}", hint, cause)


def late(url: str, wait: float) -> PolicyError:
    """No reply in time."""
    return failure(url, f"no reply within {wait:.3g} s", "timeout", "the option timeout=… waits longer")


def too_large(url: str) -> PolicyError:
    """A reply that nobody has to read to its end."""
    return failure(url, f"a reply of more than {MOST_BYTES >> 20} MiB", "protocol")


def persistently(attempt: Callable[[], Done], causes: Collection[Cause] = CONNECTION) -> Done:
    """Something done, in up to three attempts, as long as they break for one of some causes.

    It must be something that a server has no state of: a connection to open, a request to a server that keeps
    nothing, or a whole rollout.

    Raises:
        PolicyError: what the last attempt broke with, or the first that is not of these causes.
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
    """The first connection: no server now means that there is none to test. ``start``: how to start one."""
    try:
        yield
    except PolicyError as error:
        raise PrerequisiteError(f"no {protocol} server: {error.message}", hint=error.hint or start) from None


def rollout_header(start: EpisodeStart, asked: int = 0) -> dict[str, str]:
    """What our own server has to know to answer as the policy does in process.

    ``asked``: how many of the rollout's observations were sent before.
    """
    told = {"episode": start.episode, "task": start.task, "seed": start.seed, "asked": asked}
    return {ROLLOUT: json.dumps(told)}


def actions_of(reply: Mapping[Any, Any]) -> NDArray[np.float64]:
    """The ``actions`` of a reply: ``(steps, n)``, also of a single one ``(n,)``.

    Raises:
        ValueError: there are none, or they are no numbers.
    """
    if "actions" not in reply:
        raise ValueError(f"a reply without actions, but {short(sorted(map(str, reply)))}")
    return numbers(reply["actions"])


def numbers(found: object) -> NDArray[np.float64]:
    """Actions ``(steps, n)``, also of a single one ``(n,)``.

    Raises:
        ValueError: they are no numbers.
    """
    actions = np.asarray(found)  # a ragged list is a ValueError
    if actions.dtype.kind not in "iuf":
        raise ValueError(f"actions that are no numbers: {short(found)}")
    return np.atleast_2d(actions.astype(np.float64))


def array_of(data: bytes, dtype: object, shape: Any) -> NDArray[Any]:
    """An array from its bytes.

    Raises:
        ValueError: no array of numbers, or one of another size.
        TypeError: no such type.
    """
    kind = np.dtype(dtype)  # type: ignore[call-overload]  # whatever came: TypeError
    if kind.kind not in KINDS:
        raise ValueError(f"an array of {kind}")
    return np.frombuffer(data, kind).reshape(shape).copy()  # one that may be written to


def short(value: object) -> str:
    """A value in one line of at most 300 characters."""
    text = " ".join(str(value).split())
    return text if len(text) <= 300 else f"{text[:300]} …"
