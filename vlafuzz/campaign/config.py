"""Plan: the objects that a RunConfig names, all of them checked; and the start of its run."""

import hashlib
import json
import re
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from vlafuzz.campaign.causes import causes_like
from vlafuzz.campaign.fuzz import PATIENCE, Campaign
from vlafuzz.campaign.options import OF_WORLDS, RunConfig as RunConfig, severity_of_flag
from vlafuzz.campaign.tally import Summary, Tally
from vlafuzz.common.deadline import Deadline
from vlafuzz.common.plugins import OBJECT
from vlafuzz.errors import SceneError, UsageError, check_number, suggestion
from vlafuzz.failures.triage.pipeline import left_for_causes
from vlafuzz.model import Scene, Space, Task
from vlafuzz.model.conditions import check_label
from vlafuzz.model.scene_lines import is_document, load_scenes
from vlafuzz.policies.base import Policy
from vlafuzz.policies.clients.servers import names_its_model
from vlafuzz.rollouts.executor import Executor
from vlafuzz.rollouts.lockstep import lanes_for
from vlafuzz.rollouts.policies import check_policy_name
from vlafuzz.rollouts.registry import Place, default_workers, executor_at, place_of, policy_at
from vlafuzz.rollouts.setup import here, make_evaluator, with_settings
from vlafuzz.search.base import POOL, Strategy, batch_of
from vlafuzz.search.causes.strategy import Causes
from vlafuzz.search.proposals import InOrder
from vlafuzz.search.registry import strategy_factory
from vlafuzz.store.records import Manifest
from vlafuzz.store.store import Store
from vlafuzz.worlds import default_task, provenance, world_of

BUDGET = 100  # rollouts
OF_SERVER = 8  # scenes that a model server gets at a time, if it takes as many: more find fewer causes
STRATEGY = "causes"  # identifies most planted faults: scripts/bench_strategies.py
MOST = 2**63 - 1  # the largest integer of SQLite
SEARCH = 0.5  # share of the time for a run where triage follows, which takes about as many rollouts
# Share of the rollouts that certification leaves which go to causes not found yet, and the fewest that do; the others
# certify these. With a half or 0.7, as many causes are certified; without any, 0.3 to 0.5 fewer a run of 300.
FURTHER, LEAST = 0.6, 40


@dataclass(frozen=True, eq=False, kw_only=True)
class Plan:
    """A run that can be started, or with ``resume`` a stored one that can be resumed.

    ``anew``: makes the strategy again, to which a run is told when it is continued.
    ``triage_place``: where triage of the run rolls out.
    ``done``: rollouts of the stored part; ``more``: beyond the budget, see ``Campaign``.
    """

    manifest: Manifest
    space: Space
    scenes: Sequence[Scene]
    strategy: Strategy
    anew: Callable[[], Strategy]
    policy: Policy
    store: Path
    patience: int | None
    place: Place
    triage_place: Place
    resume: int | None = None
    done: int = 0
    more: int = 0


def plan(config: RunConfig, policy: Policy | None = None, space: Space | None = None) -> Plan:
    """Check a configuration, and make everything that it names but simulator and store.

    ``policy`` and ``space`` replace what it names. UsageError if a name, number or file is wrong; PrerequisiteError if
    the policy sees pictures, and none can be drawn here.
    """
    _check_numbers(config)
    named = filled(config)
    task, scenes, world = named.task, named.scenes, world_of(named.task.name)
    factory = None if config.scenes else strategy_factory(named.strategy)
    if policy is None:
        check_policy_name(named.policy)
    if space is None:
        whole = world.space(task.name, named.robot, config.operators, config.vary, config.packs)
        space = whole.narrowed(severity_of_flag(config.severity))
    budget = config.budget or (len(scenes) * config.repeats if config.scenes else BUDGET)
    if config.like:
        if named.strategy != STRATEGY:
            problem = f"--like {config.like}: strategy {named.strategy!r} learns nothing from it"
            raise UsageError(problem, hint=f"leave one of the two out: {STRATEGY} does")
        factory = partial(Causes, like=causes_like(config.like, space))
    anew = partial(factory, space, config.seed, budget // config.repeats) if factory else partial(InOrder, len(scenes))
    strategy = anew()
    place = _place(config, named.policy, min(config.batch or batch_of(strategy), budget))
    triage_place = place
    if place.kind == "processes":  # no batch bounds the workers of triage
        workers = default_workers(named.policy) if config.workers is None else config.workers
        triage_place = replace(place, workers=workers)
    policy = policy or policy_at(place, named.policy, task.name)
    if policy.spec.cameras and place.kind != "ray":
        world.check_pictures()
    batch = config.batch or max(batch_of(strategy), min(lanes_for(policy), OF_SERVER))
    label = ("" if names_its_model(named.policy) else config.alone) if config.label is None else config.label
    config = replace(config, policy=named.policy, strategy=named.strategy, budget=budget, batch=batch, label=label)
    return Plan(
        manifest=_manifest(config, space, policy, scenes, workers=place.kind != "local"),
        space=space,
        scenes=scenes,
        strategy=strategy,
        anew=anew,
        policy=policy,
        store=named.store,
        patience=None if scenes else PATIENCE,  # a file of scenes ends by itself, fair or not
        place=place,
        triage_place=triage_place,
    )


class Filled(NamedTuple):
    """Look up what a configuration names, or the default; ``scenes`` are those of its file."""

    task: Task
    robot: str
    policy: str
    strategy: str
    store: Path
    scenes: Sequence[Scene]


def filled(config: RunConfig) -> Filled:
    """Look up what a configuration names.

    Task and robot are by default those of the scenes of a file, which has a strategy of its own.
    """
    if config.scenes and config.scenes.is_file() and is_document(config.scenes):
        hint = "for VLATest's files: `vlafuzz export FILE.json --out F.jsonl` writes some"
        raise UsageError(f"{config.scenes}: not JSON lines", hint=hint)
    scenes = load_scenes(config.scenes) if config.scenes else []
    wanted = config.task or (scenes[0].task if scenes else default_task())
    _check_scenes(config, scenes, "task", wanted)
    world = world_of(wanted)
    task = world.task(wanted)
    robot = config.robot or (scenes[0].robot if scenes else next(iter(world.robots)))
    if robot not in world.robots:
        hint = suggestion(robot, world.robots)
        raise UsageError(f"robot {robot}: not for {wanted}", hint=hint)
    _check_scenes(config, scenes, "robot", robot)
    strategy = config.strategy or STRATEGY
    if config.scenes:
        if config.strategy not in (None, POOL):
            problem = f"--scenes: strategy {config.strategy!r} makes its own scenes"
            raise UsageError(problem, hint="leave one of the two out")
        strategy = POOL
    policy = config.policy or world.default_policy(robot)
    store = config.store or default_store(task.name, policy, config.seed)
    return Filled(task, robot, policy, strategy, store, scenes)


def _place(config: RunConfig, policy: str, most: int) -> Place:
    workers = config.workers
    if workers is None:
        workers = 1 if config.executor == "local" else default_workers(policy, most)
    place = place_of(workers, config.executor)
    if policy.startswith(OBJECT) and place.kind != "local":
        hint = "name a factory of yours: python:pkg.mod:factory"
        raise UsageError(f"--workers: {policy} works in this process only", hint=hint)
    return place


def default_store(task: str, policy: str, seed: int) -> Path:
    """The default path of a run's store, which all strategies share; unusual characters become dashes."""
    address = policy.partition("?")[0]
    return Path("runs") / (re.sub(r"[^\w.-]+", "-", f"{task}-{address}-{seed}") + ".db")


def _check_numbers(config: RunConfig) -> None:
    ranges = {"severity": config.severity if config.severity != 1 else None, "vary": ",".join(config.vary) or None}
    for flag, value in ranges.items():
        if config.scenes and value is not None:
            problem = f"--{flag} {value}: the scenes of --scenes are run as they are"
            raise UsageError(problem, hint="leave one of the two out")
    check_number("repeats", config.repeats, 1, MOST)
    check_number("--budget", config.budget, config.repeats, MOST)
    check_number("batch", config.batch, 1, MOST)
    check_number("--seed", config.seed, 0, MOST)
    check_label("--label", config.label)


def _check_scenes(config: RunConfig, scenes: Sequence[Scene], what: str, wanted: str) -> None:
    """Raise a SceneError if one of a file's scenes is of another task or robot than the run."""
    for number, scene in enumerate(scenes, start=1):
        if (found := getattr(scene, what)) != wanted:
            problem = f"scene {number} is of {what} {found!r}, not {wanted!r}"
            hint = f"a run has one {what}: split the file, or leave out --{what}"
            raise SceneError(f"{config.scenes}: {problem}", hint)


def _manifest(config: RunConfig, space: Space, policy: Policy, scenes: Sequence[Scene], *, workers: bool) -> Manifest:
    flags = {name: getattr(config, name) for name in Manifest.flags()}
    chosen = {name: value for name in OF_WORLDS if (value := getattr(config, name)) is not None}
    found = with_settings(space.conditions, str(config.policy), space.task.name, chosen)
    scene_file = ""
    if config.scenes:
        digest = hashlib.blake2b("\n".join(scene.digest for scene in scenes).encode(), digest_size=8).hexdigest()
        scene_file = json.dumps({"flag": "scenes", "file": str(config.scenes.resolve()), "digest": digest})
    return Manifest(
        **flags | {"task": space.task.name, "robot": space.robot},
        **here(str(config.policy), policy, space, workers=workers) | found,
        scene_file=scene_file,
        versions=provenance.versions(),
        command=config.command,
    )


def start(plan: Plan, watch: Callable[[Tally], None], deadline: Deadline | None = None) -> Summary:
    """Run a plan; after the deadline no scene is begun, and the run can be resumed."""
    # The store first: it shows at once whether it can be written, while a simulator takes seconds to start.
    with Store.open(plan.store, "write") as store, closing(make_executor(plan)) as executor:
        return fuzz(plan, store, executor, watch, deadline=deadline or Deadline())


def fuzz(plan: Plan, store: Store, executor: Executor, watch: Callable[[Tally], None], **options: Any) -> Summary:
    """Run a plan in an open store with an existing executor; ``options``: see ``Campaign``."""
    names = ("manifest", "space", "scenes", "strategy", "patience", "resume", "more")
    planned = {name: getattr(plan, name) for name in names}
    return Campaign(**planned, executor=executor, store=store, watch=watch, **options).run()


def further(plan: Plan, run: int) -> Plan | None:
    """How a run goes on after certification, with what this has left, to find causes of other failures.

    None where it does not: it ended early or has gone on already, has no failures, or hardly anything is left.
    """
    with Store.open(plan.store) as store:
        found, left = store.causes(run), left_for_causes(store, run)
        status = next(each.status for each in store.runs() if each.id == run)
        whole = status == "finished" and store.rollouts(run) <= plan.manifest.budget
    fails = found is not None and (found.causes or found.unexplained)
    if not whole or not fails or left < LEAST or not hasattr(plan.strategy, "conclude"):
        return None
    return replace(plan, strategy=plan.anew(), resume=run, more=round(FURTHER * left))


def make_executor(plan: Plan) -> Executor:
    """The executor of a plan, with its evaluator."""
    return executor_at(plan.place, partial(make_evaluator, plan.manifest), plan.policy)


def stands_alone(policy: str) -> str:
    """Why no stored outcome answers for a policy whose model nobody names, as a note."""
    return (
        f"note: {policy}: nothing says which model that is, so no stored outcome answers, and none of this "
        "run will later; ?version=NAME in the policy's name, or --label NAME of `run`, says which it is"
    )
