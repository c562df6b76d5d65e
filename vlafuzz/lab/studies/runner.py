"""The runs of a study, of random scenes and of variants of these: missing runs are done, others reused."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

from vlafuzz.campaign.config import Plan, RunConfig, plan
from vlafuzz.campaign.forecast import usual_speed
from vlafuzz.campaign.launch import SpeedOf, WantedRun, do_missing, note_places, stored_run
from vlafuzz.common.watch import Watch
from vlafuzz.errors import UsageError
from vlafuzz.model.conditions import ASKED, Origin, Role
from vlafuzz.model.outcome import Outcome, Verdict
from vlafuzz.model.scene import Scene
from vlafuzz.model.scene_lines import write_scenes
from vlafuzz.store.records import Manifest, Run, Trial
from vlafuzz.store.store import Store
from vlafuzz.worlds.manipulation.operators import ConfounderCount
from vlafuzz.worlds.tabletop.objects import Pack
from vlafuzz.worlds.tabletop.space import OperatorSet

COUNTS = (0, 1, 2, 3, 4)  # confounders in RQ2
JUDGED = (Verdict.PASSED, Verdict.FAILED)
VARIANTS = "variants"  # the strategy of runs of derived scenes, which are no random sample


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
        for name in run.manifest.differences(wanted, roles=set(Role) - {Role.PLACE}, origins=[Origin.HERE]):
            raise UsageError(
                f"{store.path}: run {run.id} was made by another version than is installed: "
                f"its {name} differs",
                hint="runs of two versions do not compare: give another --out",
            )
    return stored_run(same)


class Variant(NamedTuple):
    """A scene derived from the ``origin``-th scene of a run; ``arm`` says how."""

    scene: Scene
    origin: int
    arm: str


class Tried(NamedTuple):
    """A variant with its outcome."""

    variant: Variant
    outcome: Outcome

    @property
    def judged(self) -> bool:
        """Whether it passed or failed: neither an error nor an invalid scene is a failure."""
        return self.outcome.verdict in JUDGED

    @property
    def passed(self) -> bool:
        """Whether all its rollouts succeeded."""
        return self.outcome.verdict is Verdict.PASSED


def pooled(runs: Iterable[Sequence[Tried]]) -> list[Tried]:
    """The variants of several runs together, with distinct origins."""
    pool: list[Tried] = []
    for run in runs:
        first = 1 + max((variant.origin for variant, _ in pool), default=-1)
        pool += [Tried(variant._replace(origin=first + variant.origin), outcome) for variant, outcome in run]
    return pool


def distinct(store: Store, run: Run) -> list[Trial]:
    """The trials of a run, without those that reused an outcome."""
    return [trial for trial in store.trials(run.id) if not trial.duplicate]


def tried(store: Store, run: Run | None, variants: Sequence[Variant]) -> list[Tried]:
    """Variants with their outcomes in a run that proposed them in order; none without a run."""
    trials = store.stored(run.id, 0, len(variants)) if run else []
    return [Tried(variants[trial.proposal], trial.outcome) for trial in trials]


class _Job(NamedTuple):
    plan: Plan
    scenes: Sequence[Scene] = ()  # of a run of variants


@dataclass(frozen=True, kw_only=True)
class StudyRunner:
    """Does runs in the store of a study.

    Attributes:
        config: common to all runs; its ``budget`` is the number of random scenes of each run.
        folder: of the study, for files of variants.
        speed_of: see ``do_missing``.
        commit: of the loaded code: a later commit does not change what is running.
        left_out: parts for which no scene could be generated, and why.
    """

    config: RunConfig
    operators: OperatorSet
    store: Store
    folder: Path
    commit: str | None
    watch: Watch
    speed_of: SpeedOf = usual_speed
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

        # The paper's boxes cannot hold all confounders.
        def leave_out(run: WantedRun, error: UsageError) -> None:
            self.left_out.append(f"{run.name}: {error.message}")
            self.watch.note(f"left out: {self.left_out[-1]}")
            problems.append(error)

        wanted = [
            WantedRun(
                name=str(part),
                budget=job.plan.manifest.budget,
                plan=lambda job=job: job.plan,  # type: ignore[misc]
                stored=stored(self.store, job.plan.manifest, job.scenes),
                group=part,
                policy=job.plan.manifest.policy,
            )
            for part, job in jobs.items()
        ]
        do_missing(self.store, wanted, self.watch, leave_out, self.speed_of)
        runs = {part: stored(self.store, job.plan.manifest, job.scenes) for part, job in jobs.items()}
        done = {part: run for part, run in runs.items() if run and self.store.count(run.id)}
        note_places(done.values(), self.watch)
        if not done and problems:
            raise problems[-1]
        return done
