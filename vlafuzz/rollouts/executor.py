"""Executors evaluate scenes: the protocol, and the one that works in this process."""

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, Protocol

from vlafuzz.errors import PrerequisiteError
from vlafuzz.model import Outcome
from vlafuzz.worlds.evaluator import Evaluator

Batches = Iterable[tuple[int, Sequence[Any]] | None]
"""Tagged batches of scenes, or of what else an evaluator takes; None: to be pulled again later."""


class Executor(Protocol):
    """Evaluates batches of scenes."""

    def run(self, batches: Batches) -> Iterator[tuple[int, list[Outcome]]]:
        """Yield the outcomes of each batch, identified by its tag, in the order of completion.

        Batches are pulled when there is room for them; None in place of one means that there is none before the
        outcomes of another have been yielded. An exception during the evaluation of a scene becomes an ERROR outcome;
        only KeyboardInterrupt, and what the user must install or start first, is raised.
        """

    def close(self) -> None:
        """Release simulators and policies; no more batches follow."""


class LocalExecutor:
    """Evaluates one batch after the other in this process, each pulled when the previous one is consumed."""

    def __init__(self, evaluator: Evaluator) -> None:
        self._evaluator = evaluator

    def run(self, batches: Batches) -> Iterator[tuple[int, list[Outcome]]]:
        for tag, scenes in filter(None, batches):
            yield tag, evaluate_safely(self._evaluator, scenes)

    def close(self) -> None:
        self._evaluator.close()


def evaluate_safely(evaluator: Evaluator, scenes: Sequence[Any]) -> list[Outcome]:
    """One outcome per scene, even from an evaluator that breaks its contract."""
    try:
        outcomes = evaluator.evaluate(scenes)
    except PrerequisiteError:
        raise
    except Exception as error:  # a bug in the evaluator must not end a run of hours
        return [broken(error)] * len(scenes)
    if len(outcomes) != len(scenes):
        return [Outcome.error(f"the evaluator gave {len(outcomes)} outcomes for {len(scenes)} scenes")] * len(scenes)
    return [checked(outcome) if isinstance(outcome, Outcome) else outcome for outcome in outcomes]


def broken(error: Exception) -> Outcome:
    """The outcome of a scene in which the evaluator raised."""
    return Outcome.error(f"{type(error).__name__}: {error}")


def checked(outcome: Outcome) -> Outcome:
    """The outcome; an ERROR if its progress is not a number."""
    if math.isfinite(outcome.progress):
        return outcome
    return Outcome.error(f"the evaluator reported a progress of {outcome.progress}")
