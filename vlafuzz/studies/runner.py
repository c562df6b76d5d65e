"""The runs that a study needs: stored ones are reused, missing ones are done."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

from vlafuzz.campaign.config import Plan, RunConfig, plan
from vlafuzz.campaign.launch import WantedRun, do_missing
from vlafuzz.errors import UsageError
from vlafuzz.formats.scene_lines import write_scenes
from vlafuzz.objects import Pack
from vlafuzz.scene import Scene
from vlafuzz.space import OperatorSet
from vlafuzz.store.records import Run
from vlafuzz.store.store import Store
from vlafuzz.studies.parts import Part, operators_of, stored
from vlafuzz.studies.variants import Variant
from vlafuzz.watch import Watch

VARIANTS = "variants"  # the strategy of runs of derived scenes, which are no random sample


class _Job(NamedTuple):
    """A planned run; ``scenes`` are those of a run of variants."""

    plan: Plan
    scenes: Sequence[Scene] = ()

    def stored(self, store: Store) -> Run | None:
        return stored(store, self.plan.manifest, self.scenes)


@dataclass(frozen=True, kw_only=True)
class StudyRunner:
    """Does runs in the store of a study.

    Attributes:
        config: common to all runs; its ``budget`` is the number of random scenes of each run.
        folder: of the study, for files of variants.
        commit: of the loaded code: a later commit does not change what is running.
        left_out: parts for which no scene could be generated, and why.
    """

    config: RunConfig
    operators: OperatorSet
    store: Store
    folder: Path
    commit: str | None
    watch: Watch
    left_out: list[str] = field(default_factory=list)

    def run_random(self, parts: Iterable[Part], packs: Sequence[Pack] | None = None) -> dict[Part, Run]:
        """Runs of random scenes, without parts that have no scene; ``packs`` replace those of the config."""
        jobs = {}
        for part in parts:
            of_part = self._config(part, packs=self.config.packs if packs is None else packs)
            jobs[part] = _Job(self._plan(of_part, operators_of(part, self.operators), "random"))
        return self._complete(jobs)

    def run_variants(self, parts: Mapping[Part, tuple[OperatorSet, Sequence[Variant]]]) -> dict[Part, Run]:
        """Runs of variants, which the operators made, with the next seed; without parts that have none."""
        jobs = {}
        for part, (operators, variants) in parts.items():
            if not variants:
                continue
            scenes = [variant.scene for variant in variants]
            path = self._scene_file(part)
            write_scenes(path, scenes)
            of_part = self._config(part, scenes=path, budget=None, seed=self.config.seed + 1)
            jobs[part] = _Job(self._plan(of_part, operators, VARIANTS), scenes)
        return self._complete(jobs)

    def _config(self, part: Part, **changes: object) -> RunConfig:
        of_part = replace(self.config, task=part.task, policy=part.policy, store=self.store.path)
        return replace(of_part, **changes)  # type: ignore[arg-type]

    def _plan(self, of_part: RunConfig, operators: OperatorSet, strategy: str) -> Plan:
        planned = plan(of_part if of_part.scenes else replace(of_part, strategy=strategy), operators)
        return replace(planned, manifest=replace(planned.manifest, strategy=strategy, commit=self.commit))

    def _scene_file(self, part: Part) -> Path:
        folder = self.folder / "scenes"
        folder.mkdir(exist_ok=True)
        name = "-".join(filter(None, (part.arm, part.task, part.policy)))
        return folder / ("".join(c if c.isalnum() or c in "._-" else "-" for c in name) + ".jsonl")

    def _complete(self, jobs: Mapping[Part, _Job]) -> dict[Part, Run]:
        """Do what is missing; the runs of all parts that have a trial."""
        problems: list[UsageError] = []

        def leave_out(
            run: WantedRun, error: UsageError
        ) -> None:  # the paper's boxes cannot hold all confounders
            self.left_out.append(f"{run.name}: {error.message}")
            self.watch.note(f"left out: {self.left_out[-1]}")
            problems.append(error)

        wanted = [
            WantedRun(
                name=str(part),
                budget=job.plan.manifest.budget,
                plan=lambda job=job: job.plan,  # type: ignore[misc]
                stored=job.stored(self.store),
                group=part,
            )
            for part, job in jobs.items()
        ]
        do_missing(self.store, wanted, self.watch, leave_out)
        runs = {part: job.stored(self.store) for part, job in jobs.items()}
        done = {part: run for part, run in runs.items() if run and self.store.count(run.id)}
        if not done and problems:
            raise problems[-1]
        return done
