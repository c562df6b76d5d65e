"""The runs of a study: which there are to be, over which operators, and which of them a store has."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from vlafuzz.campaign.missing_runs import stored_run
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
        confounders: None where their number is left to the operators.
        policy: None for the default one.
        arm: what is other than in the study's first runs; nothing for these.
    """

    task: str
    confounders: int | None = None
    policy: str | None = None
    arm: str = ""

    def __str__(self) -> str:
        counted = None if self.confounders is None else f"{self.confounders} confounders"
        told = [self.policy, self.task, counted, self.arm]
        return ", ".join(each for each in told if each)


def parts_of(study: str, tasks: Sequence[str], policies: Sequence[str | None]) -> list[Part]:
    """The first runs, of each policy: a task each, in RQ2 a task and a number of confounders each."""
    counts = COUNTS if study == "rq2" else (None,)
    return [Part(task, count, policy) for policy in policies for task in tasks for count in counts]


def operators_of(part: Part, operators: OperatorSet) -> OperatorSet:
    """The operators of a part, with its number of confounders."""
    own = operators.in_task(part.task)
    if part.confounders is None:
        return own
    fixed = ConfounderCount(low=part.confounders, high=part.confounders, nominal=part.confounders)
    return replace(own, operators={**own.operators, ConfounderCount.name: fixed})


def stored(store: Store, wanted: Manifest, scenes: Sequence[Scene] = ()) -> Run | None:
    """What a store has of a part: a run that is over, else the newest that ended early.

    Args:
        wanted: the part's manifest, as it would be made now.
        scenes: of the part, where these are given; those of the run are these, or the first of them.

    Raises:
        UsageError: another version made what is there.
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
