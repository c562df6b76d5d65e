"""Executors evaluate scenes: the protocol, the one that works in this process, and one with a deadline."""

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, Protocol

from vlafuzz.common.deadline import Deadline, TimeOverError
from vlafuzz.errors import PrerequisiteError
from vlafuzz.model.outcome import Outcome
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


class Until:
    """Leaves all to another executor until the deadline; what that has begun by then, it completes."""

    def __init__(self, executor: Executor, deadline: Deadline) -> None:
        self._executor, self._deadline = executor, deadline

    def run(self, batches: Batches) -> Iterator[tuple[int, list[Outcome]]]:
        """See ``Executor``; a TimeOverError after the last outcome if a batch was left out."""
        left_out = False

        def in_time() -> Iterator[tuple[int, Sequence[Any]] | None]:
            nonlocal left_out
            for batch in batches:
                if batch is not None and (left_out := self._deadline.passed):
                    return
                yield batch

        yield from self._executor.run(in_time())
        if left_out:
            raise TimeOverError

    def close(self) -> None:
        self._executor.close()


def evaluate_safely(evaluator: Evaluator, scenes: Sequence[Any]) -> list[Outcome]:
    """One outcome per scene, even from an evaluator that breaks its contract."""
    try:
        outcomes = evaluator.evaluate(scenes)
    except PrerequisiteError:
        raise
    except Exception as error:  # a bug in the evaluator must not end a run of hours
        return [broken(error)] * len(scenes)
    if len(outcomes) != len(scenes):
        message = f"the evaluator gave {len(outcomes)} outcomes for {len(scenes)} scenes"
        return [Outcome.error(message)] * len(scenes)
    return [checked(outcome) if isinstance(outcome, Outcome) else outcome for outcome in outcomes]


def broken(error: Exception) -> Outcome:
    """The outcome of a scene in which the evaluator raised."""
    return Outcome.error(f"{type(error).__name__}: {error}")


def checked(outcome: Outcome) -> Outcome:
    """The outcome; an ERROR if its progress is not a number."""
    if math.isfinite(outcome.progress):
        return outcome
    return Outcome.error(f"the evaluator reported a progress of {outcome.progress}")
