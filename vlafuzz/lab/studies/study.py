"""The experiments of the VLATest paper: a study is a table of arms beside a control, for every policy and task."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import NamedTuple

from vlafuzz.campaign.config import Plan, RunConfig, plan
from vlafuzz.campaign.forecast import usual_speed
from vlafuzz.common.files import make_folder
from vlafuzz.common.watch import SILENT, Watch
from vlafuzz.errors import UsageError
from vlafuzz.lab.runs import SpeedOf, Wanted, complete
from vlafuzz.lab.studies.result import JUDGED, Arm, StudyResult, arm, study_result
from vlafuzz.lab.studies.variants import CONTROL, Says, Variant, mutants, paraphrases, reworded, two_steps
from vlafuzz.model.outcome import Outcome, Verdict
from vlafuzz.model.scene import Scene
from vlafuzz.model.scene_lines import write_scenes
from vlafuzz.rollouts.policies import check_policy_name
from vlafuzz.search.base import RANDOM
from vlafuzz.store.records import Run
from vlafuzz.store.store import Store
from vlafuzz.worlds.manipulation.operators import CameraOrientation, CameraPosition, ConfounderCount, Light, Wording
from vlafuzz.worlds.manipulation.rigs import PANDA, rig
from vlafuzz.worlds.provenance import commit
from vlafuzz.worlds.tabletop.objects import Pack
from vlafuzz.worlds.tabletop.objects.catalogue import stored_catalogue
from vlafuzz.worlds.tabletop.space import OperatorSet, SearchSpace, load_operators
from vlafuzz.worlds.tabletop.tasks import TASKS

COUNTS = (0, 1, 2, 3, 4)  # confounders in RQ2
MUTATED = {"rq3": (Light.name,), "rq4": (CameraPosition.name, CameraOrientation.name)}
VARIANTS = "variants"  # the strategy of runs of derived scenes, which are no random sample
UNSEEN = "unseen"
_FAIR = "scenes are first checked for fairness, with its distance, and errors do not count as failures."
_CONTROL = "it has no control arm, so that losses by chance count as effects;"
DIFFERS = {
    "rq1": f"it has 1000 scenes per task; here {_FAIR}",
    "rq2": f"it has 100 scenes per task and number; here {_FAIR}",
    "rq3": f"{_CONTROL} its light changes in pick-up only, as the other environments ignore it, and its ambient light "
    "stays as it is, while here α multiplies every light in every task. As there, three mutants of each passed scene.",
    "rq4": f"{_CONTROL} its background, a photo, changes with the camera and here it does not; it moves the camera by "
    "up to 5 cm along each of three axes (8.7 cm in all) and turns it about two axes, while here it moves by at most "
    "5 cm in any direction and turns by up to 5° about all three. As there, three mutants of each passed scene.",
    "rq5": "its unseen objects are YCB's, at half size in the put tasks, with 1000 scenes per task; here an object has "
    "the same size in all tasks, and what the gripper cannot grasp is no target. Only those who trained a policy know "
    "which objects it has seen.",
    "rq6": "it gives each scene one of ten wordings, drawn without a seed, and one of its ten for pick-up is the plain "
    "wording; here every scene is given all ten, in our words, none of them the plain one.",
    "prompts": "it tries only the two-step prompt, which is not in its code; in the other one, the second instruction "
    "replaces the first one once the grasp is reached, which the simulator knows and a real robot would not.",
}


@dataclass(frozen=True)
class StudyRequest:
    """What a user asks of a study: no tasks are all of its tasks, policy None is the default policy.

    The packs ``unseen`` hold RQ5's unseen objects.
    """

    study: str
    tasks: Sequence[str] = ()
    policies: Sequence[str | None] = (None,)
    unseen: Sequence[Pack] = ()

    def __post_init__(self) -> None:
        """Raise a UsageError for a task that a study of prompts cannot have."""
        known = [task for task in TASKS if self.study != "prompts" or two_steps(task)]
        if missing := [task for task in self.tasks if task not in known]:
            raise UsageError(f"prompts: {missing[0]} has one step only", hint=f"tasks of two steps: {', '.join(known)}")
        object.__setattr__(self, "tasks", self.tasks or known)


class Part(NamedTuple):
    """One run of a study: of random scenes, or of variants of those of another.

    Attributes:
        policy: None for the default policy.
        confounders: their number; None where the operators draw it.
    """

    task: str
    policy: str | None
    arm: str = ""
    confounders: int | None = None

    def __str__(self) -> str:
        return ", ".join(filter(None, (self.policy, self.task, self.arm)))


def ranges_for(robot: str | None) -> str:
    """The file of ranges that studies use for a robot: the paper's, or that of another robot."""
    return "paper-rq1" if robot in (None, PANDA.robot) else rig(robot).operators


def operators_of(part: Part, operators: OperatorSet) -> OperatorSet:
    """The operators of a part, with its number of confounders."""
    in_task = operators.in_task(part.task)
    if part.confounders is None:
        return in_task
    fixed = ConfounderCount(low=part.confounders, high=part.confounders, nominal=part.confounders)
    return replace(in_task, operators={**in_task.operators, ConfounderCount.name: fixed})


def study(
    request: StudyRequest, config: RunConfig, folder: Path, watch: Watch = SILENT, speed_of: SpeedOf = usual_speed
) -> StudyResult:
    """Do the runs that the folder's store lacks, each of ``config.budget`` scenes, and count all.

    ``speed_of``: see ``complete``.
    """
    operators = load_operators(config.operators)
    for policy in filter(None, request.policies):
        check_policy_name(policy)
    make_folder(folder)
    with Store.open(folder / "study.db", "write") as store:
        runner = _Runner(
            config=config,
            operators=operators,
            store=store,
            folder=folder,
            commit=commit(),
            watch=watch,
            speed_of=speed_of,
        )
        arms = _independent(runner, request) if request.study in ("rq1", "rq2", "rq5") else _paired(runner, request)
    notes = [f"What differs from the paper: {DIFFERS[request.study]}"]
    return study_result(request.study, runner.left_out, arms, notes)


def _independent(runner: "_Runner", request: StudyRequest) -> list[Arm]:
    """RQ1, RQ2 and RQ5: every arm has random scenes of its own; the first one is the control."""
    arms: dict[str, int | None] = {"random": None}  # with the number of confounders
    if request.study == "rq2":
        arms = {f"{count} confounders": count for count in COUNTS}
    elif request.study == "rq5":
        arms = {"seen": None, UNSEEN: None}
    kinds = product(request.policies, request.tasks, arms.items())
    parts = [Part(task, policy, name, count) for policy, task, (name, count) in kinds]
    runs = runner.run_random(parts, request.unseen)
    outcomes = {part: list(enumerate(outcome for _, outcome in runner.tried(run))) for part, run in runs.items()}
    first, number = next(iter(arms.items()))
    rows = []
    for part, tried in outcomes.items():
        control = None if part.arm == first else outcomes.get(part._replace(arm=first, confounders=number))
        rows.append(arm(part.task, runs[part].manifest.policy, part.arm, tried, control))
    return rows


def _paired(runner: "_Runner", request: StudyRequest) -> list[Arm]:
    """RQ3, RQ4, RQ6 and the prompts of the discussion: every arm has variants of the same scenes.

    Those are scenes that the policy passed, which the control repeats unmutated with the seed of the mutants; or all
    that were judged with the plain wording, which is the control.
    """
    bases = runner.run_random(Part(task, policy) for policy in request.policies for task in request.tasks)
    mutated = MUTATED.get(request.study)
    wanted: dict[Part, tuple[OperatorSet, list[Variant]]] = {}
    plain: dict[Part, list[tuple[int, Outcome]]] = {}
    for part, run in bases.items():
        tried = [(scene, outcome) for scene, outcome in runner.tried(run) if outcome.verdict in JUDGED]
        operators, catalogue = operators_of(part, runner.operators), stored_catalogue(run.manifest)
        if mutated:
            operators = operators.only(mutated)
            space = SearchSpace(operators, catalogue, part.task, run.manifest.robot)
            passed = [scene for scene, outcome in tried if outcome.verdict is Verdict.PASSED]
            variants = mutants(space, passed, runner.config.seed, ", ".join(mutated))
        else:
            operators, prompts = operators.only([Wording.name]), _prompts(request.study, part.task)
            variants = reworded([scene for scene, _ in tried], prompts, catalogue)
            plain[part] = [(number, outcome) for number, (_, outcome) in enumerate(tried)]
        wanted[part._replace(arm=request.study)] = operators, variants
    done = runner.run_variants(wanted)
    rows = []
    for part, run in bases.items():
        tried_in = done[part._replace(arm=request.study)]
        control = tried_in.pop(CONTROL, []) if mutated else plain[part]
        about = part.task, run.manifest.policy
        rows.append(arm(*about, CONTROL if mutated else "plain", control))
        rows += [arm(*about, name, tried, control, paired=True) for name, tried in tried_in.items()]
    return rows


def _prompts(study: str, task: str) -> list[Says]:
    return paraphrases(task) if study == "rq6" else two_steps(task)


@dataclass(frozen=True, kw_only=True)
class _Runner:
    """Does runs in the store of a study.

    Attributes:
        config: common to all runs; its ``budget`` is the number of random scenes of each run.
        folder: of the study, for files of variants.
        commit: of the loaded code: a later commit does not change what is running.
        left_out: parts for which no scene could be generated, or that ended early, and why.
    """

    config: RunConfig
    operators: OperatorSet
    store: Store
    folder: Path
    commit: str | None
    watch: Watch
    speed_of: SpeedOf
    left_out: list[str] = field(default_factory=list)

    def tried(self, run: Run) -> list[tuple[Scene, Outcome]]:
        """The distinct scenes of a run."""
        return [(trial.scene, trial.outcome) for trial in self.store.trials(run.id) if not trial.duplicate]

    def run_random(self, parts: Iterable[Part], unseen: Sequence[Pack] = ()) -> dict[Part, Run]:
        """Runs of random scenes, without parts that have no scene; of the arm ``UNSEEN`` with these packs."""
        plans = {}
        for part in parts:
            packs = unseen if part.arm == UNSEEN else self.config.packs
            operators = operators_of(part, self.operators)
            plans[part] = self._plan(part, operators, RANDOM, packs=packs, strategy=RANDOM)
        return self._complete(plans, {})

    def run_variants(
        self, parts: Mapping[Part, tuple[OperatorSet, Sequence[Variant]]]
    ) -> dict[Part, dict[str, list[tuple[int, Outcome]]]]:
        """The outcomes of each part's variants, which the operators made, by arm; in a run with the next seed."""
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
        runs = self._complete(plans, scenes)
        done: dict[Part, dict[str, list[tuple[int, Outcome]]]] = {part: {} for part in parts}
        for part, run in runs.items():
            variants = parts[part][1]
            for trial in self.store.stored(run.id, 0, len(variants)):
                variant = variants[trial.proposal]
                done[part].setdefault(variant.arm, []).append((variant.origin, trial.outcome))
        return done

    def _plan(self, part: Part, operators: OperatorSet, named: str, **changes: object) -> Plan:
        of_part = replace(self.config, task=part.task, policy=part.policy, store=self.store.path)
        planned = plan(replace(of_part, **changes), operators)  # type: ignore[arg-type]
        return replace(planned, manifest=replace(planned.manifest, strategy=named, commit=self.commit))

    def _complete(self, plans: Mapping[Part, Plan], scenes: Mapping[Part, Sequence[Scene]]) -> dict[Part, Run]:
        """Do what is missing; the runs of all parts that have a trial."""
        problems: list[UsageError] = []

        # The paper's boxes cannot hold all confounders.
        def leave_out(part: Part, error: UsageError) -> None:
            self.left_out.append(f"{part}: {error.message}")
            self.watch.note(f"left out: {self.left_out[-1]}")
            problems.append(error)

        wanted = {
            part: Wanted(planned.manifest, partial(plans.__getitem__, part), scenes.get(part, ()))
            for part, planned in plans.items()
        }
        done = complete(self.store, wanted, self.watch, self.speed_of, flag="--out", left_out=leave_out)
        early = [part for part, run in done.items() if run.status != "finished"]
        self.left_out.extend(f"{part}: ended before all scenes" for part in early)
        if not done and problems:
            raise problems[-1]
        return done
