"""Lab: the runs that a study needs, those that its store lacks with a bar."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

from vlafuzz.campaign import config, launch
from vlafuzz.campaign.config import Plan, RunConfig
from vlafuzz.cli.pace import Pace
from vlafuzz.errors import StoreError, UsageError, VlafuzzError
from vlafuzz.formats.scene_lines import write_scenes
from vlafuzz.objects import Pack
from vlafuzz.scene import Scene
from vlafuzz.space import OperatorSet
from vlafuzz.store.records import UNFINISHED, Run
from vlafuzz.store.store import Store
from vlafuzz.studies.parts import Part, operators_of, stored
from vlafuzz.studies.variants import Variant

VARIANTS = "variants"  # what stands for a strategy in runs of scenes that were made of others: no sample


class _Job(NamedTuple):
    """A run that is wanted; ``scenes`` where they are given."""

    plan: Plan
    scenes: Sequence[Scene] = ()

    def there(self, store: Store) -> Run | None:
        return stored(store, self.plan.manifest, self.scenes)


@dataclass(frozen=True)
class StudyRunner:
    """Does runs in the store of a folder.

    Attributes:
        asked: the same for all runs; its ``budget`` is the number of random scenes of each.
        commit: of the code that is loaded: what is committed in the meantime makes no other version of it.
        left_out: parts that have no scene, and why.
    """

    asked: RunConfig
    operators: OperatorSet
    store: Store
    folder: Path
    commit: str | None
    left_out: list[str] = field(default_factory=list)

    def sampled(self, parts: Iterable[Part], packs: Sequence[Pack] | None = None) -> dict[Part, Run]:
        """Runs of random scenes, of all parts that have a scene; with these packs in place of those asked."""
        jobs = {}
        for part in parts:
            own = self._own(part, packs=self.asked.packs if packs is None else packs)
            jobs[part] = _Job(self._plan(own, operators_of(part, self.operators), "random"))
        return self._done(jobs)

    def given(self, parts: Mapping[Part, tuple[OperatorSet, Sequence[Variant]]]) -> dict[Part, Run]:
        """Runs of variants in the next seed, of all parts that have any; the operators made them."""
        jobs = {}
        for part, (operators, variants) in parts.items():
            if not variants:
                continue
            scenes = [variant.scene for variant in variants]
            path = self._file(part)
            write_scenes(path, scenes)
            own = self._own(part, scenes=path, budget=None, seed=self.asked.seed + 1)
            jobs[part] = _Job(self._plan(own, operators, VARIANTS), scenes)
        return self._done(jobs)

    def _own(self, part: Part, **changes: object) -> RunConfig:
        own = replace(self.asked, task=part.task, policy=part.policy, store=self.store.path)
        return replace(own, **changes)  # type: ignore[arg-type]

    def _plan(self, own: RunConfig, operators: OperatorSet, strategy: str) -> Plan:
        made = config.plan(own if own.scenes else replace(own, strategy=strategy), operators)
        return replace(made, manifest=replace(made.manifest, strategy=strategy, commit=self.commit))

    def _file(self, part: Part) -> Path:
        folder = self.folder / "scenes"
        folder.mkdir(exist_ok=True)
        name = "-".join(filter(None, (part.arm, part.task, part.policy)))
        return folder / ("".join(c if c.isalnum() or c in "._-" else "-" for c in name) + ".jsonl")

    def _done(self, jobs: Mapping[Part, _Job]) -> dict[Part, Run]:
        there = {part: job.there(self.store) for part, job in jobs.items()}
        early = {part: run for part, run in there.items() if run is None or run.status in UNFINISHED}
        problem = self._work(jobs, early, [run for run in there.values() if run]) if early else None
        runs = {part: job.there(self.store) for part, job in jobs.items()}
        done = {part: run for part, run in runs.items() if run and self.store.count(run.id)}
        if not done and problem:
            raise problem
        return done

    def _work(
        self, jobs: Mapping[Part, _Job], early: Mapping[Part, Run | None], known: Sequence[Run]
    ) -> UsageError | None:
        """Do runs that are missing, or were cut short; why the last one that was left out was."""
        problem = None
        with Pace([jobs[part].plan.manifest.budget for part in early], known) as pace:
            for part, run in early.items():
                pace.begin(str(part))
                try:
                    _fuzz(jobs[part].plan, run, self.store, pace)
                except StoreError:
                    raise
                except UsageError as error:  # boxes of the paper have no room for all of its confounders
                    self.left_out.append(f"{part}: {error.message}")
                    pace.say(f"left out: {self.left_out[-1]}")
                    problem = error
        return problem


def _fuzz(plan: Plan, early: Run | None, store: Store, pace: Pace) -> None:
    """Begin a run, or go on with it."""
    planned = replace(plan, manifest=early.manifest, resume=early.id) if early else plan
    with closing(launch.make_executor(planned)) as executor:
        summary = launch.fuzz(planned, store, executor, pace, alone=True)
    if summary.stopped:
        pace.say(f"{summary.task} stopped: {summary.stopped}")
    if summary.verdicts["error"] and not summary.verdicts["passed"] + summary.verdicts["failed"]:
        raise VlafuzzError(
            f"no scene could be judged: {summary.last_error}",
            hint="`vlafuzz doctor` checks this machine and `vlafuzz doctor --policy` the policy",
        )
