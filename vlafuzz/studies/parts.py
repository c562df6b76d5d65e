"""The runs of a study: which are wanted, with which operators, and which of them a store has."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from vlafuzz.campaign.launch import stored_run
from vlafuzz.conditions.conditions import ASKED, Origin
from vlafuzz.errors import UsageError
from vlafuzz.scene import Scene
from vlafuzz.space import OperatorSet
from vlafuzz.space.operators import ConfounderCount
from vlafuzz.store.records import Manifest, Run
from vlafuzz.store.store import Store

COUNTS = (0, 1, 2, 3, 4)  # confounders in RQ2


class Part(NamedTuple):
    """One run of a study.

    Attributes:
        confounders: their number; None where the operators draw it.
        policy: None for the default policy.
        arm: what differs from the study's runs of random scenes; empty for these.
    """

    task: str
    confounders: int | None = None
    policy: str | None = None
    arm: str = ""

    def __str__(self) -> str:
        confounders = None if self.confounders is None else f"{self.confounders} confounders"
        return ", ".join(filter(None, (self.policy, self.task, confounders, self.arm)))


def parts_of(study: str, tasks: Sequence[str], policies: Sequence[str | None]) -> list[Part]:
    """The runs of random scenes: one per policy and task, in RQ2 also per number of confounders."""
    counts = COUNTS if study == "rq2" else (None,)
    return [Part(task, count, policy) for policy in policies for task in tasks for count in counts]


def operators_of(part: Part, operators: OperatorSet) -> OperatorSet:
    """The operators of a part, with its number of confounders."""
    in_task = operators.in_task(part.task)
    if part.confounders is None:
        return in_task
    fixed = ConfounderCount(low=part.confounders, high=part.confounders, nominal=part.confounders)
    return replace(in_task, operators={**in_task.operators, ConfounderCount.name: fixed})


def stored(store: Store, wanted: Manifest, scenes: Sequence[Scene] = ()) -> Run | None:
    """The run of a part that a store has, finished or not.

    Args:
        wanted: the part's manifest, as it would be made now.
        scenes: the variants of the part, if it has any; the run has them or the first of them.

    Raises:
        UsageError: another version made the run.
    """
    same = [
        run
        for run in store.runs()
        if not run.manifest.differences(wanted, origins=ASKED)
        and (not scenes or all(trial.scene == scenes[trial.proposal] for trial in store.trials(run.id)))
    ]
    for run in same:
        for name in run.manifest.differences(wanted, origins=[Origin.HERE]):
            raise UsageError(
                f"{store.path}: run {run.id} was made by another version than is installed: "
                f"its {name} differs",
                hint="runs of two versions do not compare: give another --out",
            )
    return stored_run(same)
