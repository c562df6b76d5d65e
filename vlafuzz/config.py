"""RunConfig: what a user asks of a run. Plan: the objects that it names, all of them checked."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
from importlib import metadata
from pathlib import Path

from vlafuzz import __version__, campaign
from vlafuzz.corpus.records import Manifest
from vlafuzz.corpus.store import Corpus
from vlafuzz.corpus.tally import Summary, Tally
from vlafuzz.errors import SceneError, UsageError, suggestion
from vlafuzz.execute.local import LocalExecutor
from vlafuzz.objects.catalogue import Catalogue, load_catalogue
from vlafuzz.scene import Scene, load_scenes
from vlafuzz.search.base import Strategy
from vlafuzz.search.pool import InOrder, Pool
from vlafuzz.search.registry import POOL, strategy_factory
from vlafuzz.sim.base import Evaluator
from vlafuzz.space import OperatorSet, SearchSpace, load_operators
from vlafuzz.subjects.base import Subject
from vlafuzz.subjects.registry import check_subject_name, make_subject
from vlafuzz.tasks.base import Task
from vlafuzz.tasks.tabletop import task as find_task

BUDGET = 100  # rollouts
MOST = 2**63 - 1
CRITERIA = ("strict", "published")
_PACKAGES = ("mani_skill", "sapien", "torch", "numpy", "scipy")


@dataclass(frozen=True)
class RunConfig:
    """What a user asks of a run.

    Attributes:
        task: None for the one that ``scenes`` are of, else pick-up.
        strategy: None for the scenes of a file in order, else random.
        budget: in subject rollouts; None for all scenes of a file, else 100.
        batch: proposals that are asked for at once.
        repeats: rollouts a scene.
        criteria: what success means: ``strict`` as the task's words, or ``published``.
        operators: a file of ranges, or the name of a shipped one; None for tabletop.
        vary: operators that vary; none for all that the file varies.
        scenes: a file of scenes to run in place of generated ones.
        store: None for ``runs/<task>-<subject>-<strategy>-<seed>.db``.
    """

    task: str | None = None
    subject: str = "pinhole"
    strategy: str | None = None
    budget: int | None = None
    seed: int = 0
    batch: int = 16
    repeats: int = 1
    stop_early: bool = False
    criteria: str = "strict"
    operators: str | None = None
    vary: tuple[str, ...] = ()
    scenes: Path | None = None
    store: Path | None = None
    command: str = ""


@dataclass(frozen=True, eq=False)
class Plan:
    """A run that can be started."""

    manifest: Manifest
    task: Task
    space: campaign.Space
    strategy: Strategy
    subject: Subject
    catalogue: Catalogue
    store: Path
    patience: int | None


def plan(config: RunConfig) -> Plan:
    """Check what the user asks for and make everything but simulator and store.

    Raises:
        UsageError: a name, number or file is wrong.
    """
    _check_numbers(config)
    scenes = load_scenes(config.scenes) if config.scenes else []
    task = _task(config, scenes)
    strategy_name = _strategy_name(config)
    factory = None if scenes else strategy_factory(strategy_name)
    check_subject_name(config.subject)
    operators = load_operators(config.operators)
    operators = operators.only(config.vary) if config.vary else operators
    catalogue = load_catalogue()
    space = SearchSpace(operators, catalogue, task.name)
    strategy = InOrder(len(scenes)) if factory is None else factory(space, config.seed)
    subject = make_subject(config.subject)
    budget = config.budget or (len(scenes) * config.repeats if scenes else BUDGET)
    return Plan(
        manifest=_manifest(config, strategy_name, budget, space, subject),
        task=task,
        space=Pool(scenes, space) if scenes else space,
        strategy=strategy,
        subject=subject,
        catalogue=catalogue,
        store=config.store or default_store(task.name, config.subject, strategy_name, config.seed),
        patience=None if scenes else campaign.PATIENCE,  # a file of scenes ends by itself, fair or not
    )


def start(plan: Plan, watch: Callable[[Tally], None]) -> Summary:
    """Run it in this process."""
    with closing(make_evaluator(plan)) as evaluator, Corpus.open(plan.store, "write") as corpus:
        return campaign.fuzz(
            manifest=plan.manifest,
            stages=plan.task.stage_names,
            space=plan.space,
            strategy=plan.strategy,
            executor=LocalExecutor(evaluator),
            corpus=corpus,
            patience=plan.patience,
            watch=watch,
        )


def make_evaluator(plan: Plan) -> Evaluator:
    """The simulator with the subject in it: from here on, seconds go by."""
    from vlafuzz.sim.maniskill.evaluator import ManiSkillEvaluator

    manifest = plan.manifest
    return ManiSkillEvaluator(
        plan.task.name,
        plan.subject,
        plan.catalogue,
        min_distance=manifest.min_distance,
        seed=manifest.seed,
        repeats=manifest.repeats,
        stop_early=manifest.stop_early,
        criteria=manifest.criteria,
    )


def default_store(task: str, subject: str, strategy: str, seed: int) -> Path:
    """Where a run is kept unless told otherwise; a name's awkward characters become dashes."""
    name = f"{task}-{subject}-{strategy}-{seed}"
    return Path("runs") / ("".join(c if c.isalnum() or c in "._-" else "-" for c in name) + ".db")


def _check_numbers(config: RunConfig) -> None:
    for name, value, least in (
        ("--repeats", config.repeats, 1),
        ("--budget", config.budget, config.repeats),
        ("--batch", config.batch, 1),
        ("--seed", config.seed, 0),
    ):
        if value is not None and value < least:
            raise UsageError(
                f"{name}: expected at least {least}, got {value}", hint=f"give {name} {least} or more"
            )
        if value is not None and value > MOST:
            raise UsageError(
                f"{name}: expected at most {MOST}, got {value}", hint="stores hold 64-bit numbers"
            )
    if config.criteria not in CRITERIA:
        raise UsageError(f"unknown criteria {config.criteria!r}", hint=suggestion(config.criteria, CRITERIA))


def _task(config: RunConfig, scenes: Sequence[Scene]) -> Task:
    wanted = config.task or (scenes[0].task if scenes else "pick-up")
    for number, scene in enumerate(scenes, start=1):
        if scene.task != wanted:
            raise SceneError(
                f"{config.scenes}: scene {number} is of task {scene.task!r}, not {wanted!r}",
                hint="a run has one task: split the file, or give --task",
            )
    return find_task(wanted)


def _strategy_name(config: RunConfig) -> str:
    if config.scenes is None:
        return config.strategy or "random"
    if config.strategy not in (None, POOL):
        raise UsageError(
            f"--scenes: strategy {config.strategy!r} makes its own scenes", hint="leave one of the two out"
        )
    return POOL


def _manifest(
    config: RunConfig, strategy: str, budget: int, space: SearchSpace, subject: Subject
) -> Manifest:
    versions, operators = _versions(), space.operators
    return Manifest(
        task=space.task.name,
        subject=config.subject,
        spec=json.dumps(asdict(subject.spec), sort_keys=True),
        strategy=strategy,
        budget=budget,
        batch=config.batch,
        seed=config.seed,
        repeats=config.repeats,
        criteria=config.criteria,
        stop_early=config.stop_early,
        min_distance=operators.min_distance,
        operators=_operators_json(operators),
        operators_digest=operators.digest,
        catalogue_digest=space.catalogue.digest,
        simulator="/".join(f"{name} {versions.get(name)}" for name in ("vlafuzz", "mani_skill", "sapien")),
        versions=versions,
        commit=_commit(),
        command=config.command,
    )


def _operators_json(operators: OperatorSet) -> str:
    ranges = {name: operator.model_dump(mode="json") for name, operator in operators.operators.items()}
    varied = sorted(operators.varied)
    return json.dumps(
        {"min_distance": operators.min_distance, "varied": varied, "operators": ranges}, sort_keys=True
    )


def _versions() -> dict[str, str]:
    found = {"vlafuzz": __version__}
    for name in _PACKAGES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return found


def _commit() -> str | None:
    """Of the checkout that this package is in, if it is one."""
    here = Path(__file__).resolve().parent
    if not (here.parent / ".git").exists():
        return None
    try:
        done = subprocess.run(
            ["git", "-C", str(here), "rev-parse", "HEAD"],
            capture_output=True,
            text=True,
            timeout=5,
            check=True,
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip()
