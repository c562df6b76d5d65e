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
from vlafuzz.lab.versions import check_one_version
from vlafuzz.model.conditions import ASKED
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


def operators_of(part: Part, operators: OperatorSet) -> OperatorSet:
    """The operators of a part, with its number of confounders."""
    in_task = operators.in_task(part.task)
    if part.confounders is None:
        return in_task
    fixed = ConfounderCount(low=part.confounders, high=part.confounders, nominal=part.confounders)
    return replace(in_task, operators={**in_task.operators, ConfounderCount.name: fixed})


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
    check_one_version(store.path, same, wanted, "--out")
    return stored_run(same)


@dataclass(frozen=True, kw_only=True)
class StudyRunner:
    """Does runs in the store of a study.

    Attributes:
        config: common to all runs; its ``budget`` is the number of random scenes of each run. folder: of the study, for
        files of variants.
        commit: of the loaded code: a later commit does not change what is running.
        speed_of: see ``do_missing``.
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
        packs = self.config.packs if packs is None else packs
        plans = {
            part: self._plan(part, operators_of(part, self.operators), "random", packs=packs, strategy="random")
            for part in parts
        }
        return self._complete(plans, {})

    def run_variants(self, parts: Mapping[Part, tuple[OperatorSet, Sequence[Variant]]]) -> dict[Part, list[Tried]]:
        """The variants of each part, which the operators made, in a run with the next seed."""
        scenes = {part: [one.scene for one in variants] for part, (_, variants) in parts.items() if variants}
        plans = {}
        for part, of_part in scenes.items():
            name = "-".join(filter(None, (part.arm, part.task, part.policy)))
            name = "".join(c if c.isalnum() or c in "._-" else "-" for c in name)
            path = self.folder / "scenes" / f"{name}.jsonl"
            path.parent.mkdir(exist_ok=True)
            write_scenes(path, of_part)
            seed = self.config.seed + 1
            plans[part] = self._plan(part, parts[part][0], VARIANTS, scenes=path, budget=None, seed=seed)
        runs, done = self._complete(plans, scenes), {}
        for part, (_, variants) in parts.items():
            trials = self.store.stored(runs[part].id, 0, len(variants)) if part in runs else []
            done[part] = [Tried(variants[trial.proposal], trial.outcome) for trial in trials]
        return done

    def _plan(self, part: Part, operators: OperatorSet, named: str, **changes: object) -> Plan:
        of_part = replace(self.config, task=part.task, policy=part.policy, store=self.store.path)
        planned = plan(replace(of_part, **changes), operators)  # type: ignore[arg-type]
        return replace(planned, manifest=replace(planned.manifest, strategy=named, commit=self.commit))

    def _complete(self, plans: Mapping[Part, Plan], scenes: Mapping[Part, Sequence[Scene]]) -> dict[Part, Run]:
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
                budget=planned.manifest.budget,
                plan=lambda planned=planned: planned,  # type: ignore[misc]
                stored=stored(self.store, planned.manifest, scenes.get(part, ())),
                group=part,
                policy=planned.manifest.policy,
            )
            for part, planned in plans.items()
        ]
        do_missing(self.store, wanted, self.watch, leave_out, self.speed_of)
        runs = {part: stored(self.store, plans[part].manifest, scenes.get(part, ())) for part in plans}
        done = {part: run for part, run in runs.items() if run and self.store.count(run.id)}
        note_places(done.values(), self.watch)
        if not done and problems:
            raise problems[-1]
        return done
