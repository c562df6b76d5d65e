"""The runs of a comparison: which are wanted, and which of them a store has."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

from vlafuzz.campaign.launch import stored_run
from vlafuzz.conditions.conditions import ASKED, Origin
from vlafuzz.errors import UsageError
from vlafuzz.store.records import UNFINISHED, Manifest, Run

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
    """All runs, one of every strategy before the second of any: an interrupted comparison is balanced."""
    return [Job(name, seed + number) for number in range(repeats) for name in strategies]


def stored(path: Path, runs: Iterable[Run], here: Manifest, wanted: Sequence[Job]) -> dict[Job, Run]:
    """The runs of a comparison that a store has, finished or not. Other strategies and seeds are ignored.

    Args:
        here: the manifest of any of its runs, as it would be made now.

    Raises:
        UsageError: the store has runs under other conditions, or runs that cannot be resumed here.
    """
    by_job: dict[Job, list[Run]] = {}
    for run in runs:
        _check_alike(path, run, here)
        by_job.setdefault(Job(run.manifest.strategy, run.manifest.seed), []).append(run)
    known = {job: best for job in wanted if (best := stored_run(by_job.get(job, [])))}
    complete = len(known) == len(wanted) and all(run.status not in UNFINISHED for run in known.values())
    _check_versions(path, list(known.values()), None if complete else here)
    return known


def _check_alike(path: Path, run: Run, wanted: Manifest) -> None:
    for name in run.manifest.differences(wanted, origins=ASKED):
        if name in Job._fields:
            continue
        was, now = getattr(run.manifest, name), getattr(wanted, name)
        difference = _SAID.get(name, f"{name} {was}, not {now}")
        raise UsageError(f"{path}: run {run.id} has other conditions: {difference}", hint=_ELSEWHERE)


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
