"""Executors evaluate scenes: the protocol, and the one that works in this process."""

import math
from collections.abc import Iterable, Iterator
from typing import Any, Protocol

from vlafuzz.errors import PrerequisiteError
from vlafuzz.model import Outcome
from vlafuzz.worlds.evaluator import Evaluator

Tagged = Iterable[tuple[int, Any] | None]
"""Scenes, or what else an evaluator takes, each with its tag; None: to be pulled again later."""


class Executor(Protocol):
    """Evaluates scenes."""

    def run(self, scenes: Tagged) -> Iterator[tuple[int, Outcome]]:
        """Yield the outcome of each scene, identified by its tag, in the order of completion.

        Scenes are pulled when there is room for them; None in place of one means that there is none before the outcome
        of another has been yielded. An exception during the evaluation of a scene becomes an ERROR outcome; only
        KeyboardInterrupt, and what the user must install or start first, is raised.
        """

    def close(self) -> None:
        """Release simulators and policies; no more scenes follow."""


class LocalExecutor:
    """Evaluates one scene after the other in this process, each pulled when the previous one is consumed."""

    def __init__(self, evaluator: Evaluator) -> None:
        self._evaluator = evaluator

    def run(self, scenes: Tagged) -> Iterator[tuple[int, Outcome]]:
        for tag, scene in filter(None, scenes):
            yield tag, evaluate_safely(self._evaluator, scene)

    def close(self) -> None:
        self._evaluator.close()


def evaluate_safely(evaluator: Evaluator, scene: Any) -> Outcome:
    """The outcome of a scene, even from an evaluator that breaks its contract."""
    try:
        (outcome,) = evaluator.evaluate([scene])
    except PrerequisiteError:
        raise
    except Exception as error:  # a bug in the evaluator must not end a run of hours
        return broken(error)
    return checked(outcome) if isinstance(outcome, Outcome) else outcome


def broken(error: Exception) -> Outcome:
    """The outcome of a scene in which the evaluator raised."""
    return Outcome.error(f"{type(error).__name__}: {error}")


def checked(outcome: Outcome) -> Outcome:
    """The outcome; an ERROR if its progress is not a number."""
    if math.isfinite(outcome.progress):
        return outcome
    return Outcome.error(f"the evaluator reported a progress of {outcome.progress}")
