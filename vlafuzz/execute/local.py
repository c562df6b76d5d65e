"""LocalExecutor: scenes are evaluated in this process."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence

from vlafuzz.errors import PrerequisiteError
from vlafuzz.outcome import Outcome
from vlafuzz.scene import Scene
from vlafuzz.sim.base import Evaluator


class LocalExecutor:
    """One batch after the other, each pulled when the one before is taken."""

    def __init__(self, evaluator: Evaluator) -> None:
        self._evaluator = evaluator

    def run(self, batches: Iterable[tuple[int, Sequence[Scene]]]) -> Iterator[tuple[int, list[Outcome]]]:
        """See ``Executor``."""
        for tag, scenes in batches:
            yield tag, evaluate_safely(self._evaluator, scenes)

    def close(self) -> None:
        """See ``Executor``."""
        self._evaluator.close()


def evaluate_safely(evaluator: Evaluator, scenes: Sequence[Scene]) -> list[Outcome]:
    """One outcome a scene, also from an evaluator that breaks its contract."""
    try:
        outcomes = evaluator.evaluate(scenes)
    except PrerequisiteError:
        raise
    except Exception as error:  # a bug in there must not end a run of hours
        return [Outcome.error(f"{type(error).__name__}: {error}")] * len(scenes)
    if len(outcomes) != len(scenes):
        told = f"the evaluator gave {len(outcomes)} outcomes for {len(scenes)} scenes"
        return [Outcome.error(told)] * len(scenes)
    return [_sound(outcome) for outcome in outcomes]


def _sound(outcome: Outcome) -> Outcome:
    if math.isfinite(outcome.progress):
        return outcome
    return Outcome.error(f"the evaluator reported a progress of {outcome.progress}")
