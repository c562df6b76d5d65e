"""The runs of a comparison or a study: what its store lacks is done, the rest is taken from there."""

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

from vlafuzz.campaign.config import Plan
from vlafuzz.campaign.forecast import usual_speed
from vlafuzz.campaign.launch import SpeedOf, WantedRun, do_missing, note_places, stored_run
from vlafuzz.common.watch import Watch
from vlafuzz.errors import UsageError
from vlafuzz.model.conditions import ASKED, Origin, Role
from vlafuzz.model.scene import Scene
from vlafuzz.store.records import Manifest, Run
from vlafuzz.store.store import Store

Key = TypeVar("Key", bound=Hashable)


@dataclass(frozen=True, kw_only=True)
class Wanted:
    """A run that is needed.

    Attributes:
        manifest: as the run would have it if it began now; batches may differ, as they suit the strategy.
        scenes: that the run has in this order, where they are given.
        group: adjacent runs of one group share an executor.
        triage: rollouts for triage of the run, afterwards.
    """

    manifest: Manifest
    plan: Callable[[], Plan]
    scenes: Sequence[Scene] = ()
    group: object
    triage: int = 0


def complete(
    store: Store,
    wanted: Mapping[Key, Wanted],
    watch: Watch,
    speed_of: SpeedOf = usual_speed,
    *,
    flag: str,
    left_out: Callable[[WantedRun, UsageError], None] | None = None,
) -> dict[Key, Run]:
    """Do the runs that a store lacks, named after their keys, in order; all of them that have a trial.

    Args:
        flag: the option that names another place for the runs of another version.
        left_out, speed_of: see ``do_missing``.
    """
    missing = [
        WantedRun(
            name=str(key),
            budget=one.manifest.budget,
            plan=one.plan,
            stored=stored(store, one.manifest, flag, one.scenes),
            group=one.group,
            policy=one.manifest.policy,
            triage=one.triage,
        )
        for key, one in wanted.items()
    ]
    do_missing(store, missing, watch, left_out, speed_of)
    runs = {key: stored(store, one.manifest, flag, one.scenes) for key, one in wanted.items()}
    done = {key: run for key, run in runs.items() if run and store.count(run.id)}
    note_places(done.values(), watch)
    return done


def stored(store: Store, wanted: Manifest, flag: str, scenes: Sequence[Scene] = ()) -> Run | None:
    """The run that a store has of these conditions, finished or not; with scenes, one of these or the first of them.

    Raises:
        UsageError: another version made the run.
    """
    same = [
        run
        for run in store.runs()
        if set(run.manifest.differences(wanted, origins=ASKED)) <= {"batch"}
        and (not scenes or all(trial.scene == scenes[trial.proposal] for trial in store.trials(run.id)))
    ]
    for run in same:
        for name in run.manifest.differences(wanted, roles=set(Role) - {Role.PLACE}, origins=[Origin.HERE]):
            raise UsageError(
                f"{store.path}: run {run.id} was made by another version than is installed: its {name} differs",
                hint=f"runs of two versions do not compare: give another {flag}",
            )
    return stored_run(same)
