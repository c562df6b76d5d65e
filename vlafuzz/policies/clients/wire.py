"""What the clients of all model servers share: error messages, retries, and checks of replies, which are untrusted."""

import json
import logging
import time
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ValidationError

from vlafuzz.common.reading import KINDS, first_problem
from vlafuzz.common.text import shortened
from vlafuzz.errors import Cause, PolicyError, PrerequisiteError, sentence
from vlafuzz.policies.base import EpisodeStart

MOST_VALUES = 1 << 16  # in the lists and maps of a message, where a byte may become 80; arrays are one each
PAUSES = (0.5, 1.0)  # seconds before the second and the third attempt
CONNECTION: tuple[Cause, ...] = ("connect",)
UNANSWERED: tuple[Cause, ...] = (*CONNECTION, "timeout")
# Identifies the rollout of a connection, where the protocol cannot; only our own servers read it.
ROLLOUT = "Vlafuzz-Rollout"
LOG = logging.getLogger(__name__)  # one line per retry
T = TypeVar("T")
Declared = TypeVar("Declared", bound=BaseModel)


def failure(url: str, message: str, cause: Cause, hint: str | None = None) -> PolicyError:
    """A PolicyError that names the server."""
    return PolicyError(f"{url}: {message}", hint, cause)


def replaced(name: str) -> PolicyError:
    """The error for a server that declares something else than the one before it."""
    return PolicyError(f"{name}: another server answers than at the beginning of the run", cause="protocol")


@contextmanager
def read(what: str, cause: Cause = "protocol") -> Iterator[None]:
    """Convert a ValueError in the block, which reads a message or actions, to a PolicyError."""
    try:
        yield
    except ValueError as error:
        raise PolicyError(f"{what}: {error}", cause=cause) from None


@contextmanager
def required(protocol: str, start: str) -> Iterator[None]:
    """Open the first connection in the block; PrerequisiteError, with ``start`` as hint, without a server."""
    try:
        yield
    except PolicyError as error:
        raise PrerequisiteError(f"no {protocol} server: {error.message}", hint=error.hint or start) from None


@contextmanager
def closed_on_error(connection: Any) -> Iterator[None]:
    """Close the connection when the block raises, which prepares it."""
    try:
        yield
    except BaseException:
        connection.close()
        raise


def validated(kind: type[Declared], url: str, what: str, declared: object) -> Declared:
    """What a server declares about itself; PolicyError when it is malformed, with the place."""
    try:
        return kind.model_validate(declared)
    except ValidationError as error:
        raise failure(url, f"its {what}: {first_problem(error)}", "protocol") from None


def with_retries(attempt: Callable[[], T]) -> T:
    """The result of ``attempt``, which is repeated up to twice when it cannot connect.

    Retry only what leaves no state in the server: opening a connection, or a request to a stateless server.
    """
    for pause in PAUSES:
        try:
            return attempt()
        except PolicyError as error:
            check_repeatable(error, pause, CONNECTION)
        time.sleep(pause)
    return attempt()


def check_repeatable(error: PolicyError, pause: float, causes: Collection[Cause]) -> None:
    """Raise an error that has none of the causes; else log that the attempt is repeated after the pause."""
    if error.cause not in causes:
        raise error
    LOG.warning("%s; again in %g s", error, pause)


def rollout_header(start: EpisodeStart, sent: int = 0) -> dict[str, str]:
    """What our own server must know to answer exactly as in process. ``sent``: observations sent before."""
    rollout = {"episode": start.episode, "task": start.task, "seed": start.seed, "asked": sent}
    return {ROLLOUT: json.dumps(rollout)}


def actions_of(reply: Mapping[Any, Any]) -> NDArray[np.float64]:
    """The ``actions`` of a reply, see ``numbers``; ValueError when there are none."""
    if "actions" not in reply:
        raise ValueError(f"a reply without actions, but {short(sorted(map(str, reply)))}")
    return numbers(reply["actions"])


def numbers(value: object) -> NDArray[np.float64]:
    """Actions as ``(steps, n)``, a single action ``(n,)`` as one step; ValueError when not of numbers."""
    actions = np.asarray(value)  # a ragged list raises ValueError
    if actions.dtype.kind not in "iuf":
        raise ValueError(f"actions that are no numbers: {short(value)}")
    with np.errstate(over="ignore"):  # infinity is refused later, like any other action that is not finite
        return np.atleast_2d(actions.astype(np.float64))


def check_sendable(value: Any, kind: Any = np.ndarray) -> None:
    """Raise TypeError for what is no array of numbers."""
    if not isinstance(value, kind) or value.dtype.kind not in KINDS:
        raise TypeError(f"{type(value).__name__} cannot be sent")


def short(value: object) -> str:
    """A text, an error or another value as one line of at most 300 characters."""
    return sentence(value) if isinstance(value, str | Exception) else shortened(value, 300)
