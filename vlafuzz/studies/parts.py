"""The runs of a study: which there are to be, over which operators, and which of them a store has."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from vlafuzz.corpus.records import UNFINISHED, Manifest, Run
from vlafuzz.errors import UsageError
from vlafuzz.space import OperatorSet
from vlafuzz.space.operators import ConfounderCount

COUNTS = (0, 1, 2, 3, 4)  # confounders in RQ2
_SAME = (
    "task", "subject", "strategy", "budget", "seed", "batch", "repeats", "criteria", "stop_early",
    "operators_digest",
)  # fmt: skip
_OF_VERSION = ("spec", "catalogue_digest", "simulator", "commit")


class Part(NamedTuple):
    """One run of a study.

    Attributes:
        confounders: None where their number is left to the operators.
        subject: None for the default one.
    """

    task: str
    confounders: int | None = None
    subject: str | None = None

    def __str__(self) -> str:
        told = [
            self.subject,
            self.task,
            None if self.confounders is None else f"{self.confounders} confounders",
        ]
        return ", ".join(each for each in told if each)


def parts_of(study: str, tasks: Sequence[str], subjects: Sequence[str | None]) -> list[Part]:
    """All runs, of each subject: a task each in RQ1, a task and a number of confounders each in RQ2."""
    counts = (None,) if study == "rq1" else COUNTS
    return [Part(task, count, subject) for subject in subjects for task in tasks for count in counts]


def operators_of(part: Part, operators: OperatorSet) -> OperatorSet:
    """The operators of a part, with its number of confounders."""
    own = operators.in_task(part.task)
    if part.confounders is None:
        return own
    fixed = ConfounderCount(low=part.confounders, high=part.confounders, nominal=part.confounders)
    return replace(own, operators={**own.operators, ConfounderCount.name: fixed})


def stored(path: Path, runs: Iterable[Run], wanted: Manifest) -> Run | None:
    """What a store has of a part: a run that is over, else the newest that ended early.

    Args:
        wanted: the part's manifest, as it would be made now.

    Raises:
        UsageError: another version made what is there.
    """
    same = [run for run in runs if all(getattr(run.manifest, n) == getattr(wanted, n) for n in _SAME)]
    for run in same:
        for name in _OF_VERSION:
            if getattr(run.manifest, name) != getattr(wanted, name):
                raise UsageError(
                    f"{path}: run {run.id} was made by another version than is here: its {name} differs",
                    hint="runs of two versions do not compare: give another --out",
                )
    over = [run for run in same if run.status not in UNFINISHED]
    return (over or same)[-1] if same else None
