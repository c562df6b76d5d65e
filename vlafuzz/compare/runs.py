"""The runs of a comparison: which there are to be, which a store has, and how the others come about."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import closing
from itertools import groupby
from pathlib import Path
from typing import NamedTuple, TypeVar

from vlafuzz.conditions.conditions import ASKED, Origin
from vlafuzz.errors import UsageError
from vlafuzz.execute.base import Executor
from vlafuzz.store.records import UNFINISHED, Manifest, Run

Planned = TypeVar("Planned")

# Values that are too long for a message.
_SAID = {
    "operators_digest": "other operators, or other ranges",
    "packs": "other packs of objects",
    "scene_file": "another pool of scenes",
}
_ELSEWHERE = "give another --store for another comparison, or the flags of the runs in there"


class Job(NamedTuple):
    """One run: the n-th of every strategy has the same seed."""

    strategy: str
    seed: int


def jobs(strategies: Sequence[str], repeats: int, seed: int) -> list[Job]:
    """All runs, one of every strategy before the second of any: cut short, they are balanced."""
    return [Job(name, seed + number) for number in range(repeats) for name in strategies]


def stored(path: Path, runs: Iterable[Run], wanted: Manifest, asked: Sequence[Job]) -> dict[Job, Run]:
    """What a store has of a comparison: of each job a run that is over, else the newest that ended early.

    Runs of other strategies and seeds may be there, too: they are left alone.

    Args:
        wanted: the manifest of any of its runs, as it would be made now.

    Raises:
        UsageError: the store has runs of other conditions, or what is there cannot be gone on with here.
    """
    found: dict[Job, Run] = {}
    for run in runs:
        _check_alike(path, run, wanted)
        job = Job(run.manifest.strategy, run.manifest.seed)
        if job in asked and (job not in found or found[job].status in UNFINISHED):
            found[job] = run
    _check_versions(path, list(found.values()), None if not todo(asked, found) else wanted)
    return found


def todo(asked: Sequence[Job], found: Mapping[Job, Run]) -> list[Job]:
    """The jobs that are to be begun, or gone on with."""
    return [job for job in asked if job not in found or found[job].status in UNFINISHED]


def work_through(
    missing: Sequence[Job],
    plan: Callable[[Job], Planned],
    executor: Callable[[Planned], Executor],
    fuzz: Callable[[Planned, Executor], None],
) -> None:
    """Do all that is missing. Runs of one seed share an executor: no strategy decides over what it does.

    Args:
        plan: makes what is needed to begin a run, or to go on with it.
        executor: makes what evaluates its scenes.
        fuzz: runs it.
    """
    for _, group in groupby(missing, key=lambda job: job.seed):
        first, *rest = group
        planned = plan(first)
        with closing(executor(planned)) as tools:
            fuzz(planned, tools)
            for job in rest:
                fuzz(plan(job), tools)


def _check_alike(path: Path, run: Run, wanted: Manifest) -> None:
    for name in run.manifest.differences(wanted, origins=ASKED):
        if name in Job._fields:
            continue
        was, now = getattr(run.manifest, name), getattr(wanted, name)
        difference = _SAID.get(name, f"{name} {was}, not {now}")
        raise UsageError(f"{path}: run {run.id} is of other conditions: {difference}", hint=_ELSEWHERE)


def _check_versions(path: Path, runs: Sequence[Run], here: Manifest | None) -> None:
    """That one version made all of them; with ``here`` that it is this one, too."""
    first = here or (runs[0].manifest if runs else None)
    for run in runs:
        for name in run.manifest.differences(first or run.manifest, origins=[Origin.HERE]):
            other = "is installed" if here else f"run {runs[0].id}"
            raise UsageError(
                f"{path}: run {run.id} was made by another version than {other}: its {name} differs",
                hint="runs of two versions do not compare: give another --store",
            )
