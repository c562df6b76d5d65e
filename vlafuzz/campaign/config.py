"""RunConfig: what a user asks of a run. Plan: the objects that it names, all of them checked."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from vlafuzz import assets
from vlafuzz.campaign.clusters import Embed
from vlafuzz.campaign.fuzz import PATIENCE, Space
from vlafuzz.campaign.resume import check_version, unfinished
from vlafuzz.campaign.scene_file import check_scene_file, read_scene_file, scene_file_json, stored_flag
from vlafuzz.conditions import provenance
from vlafuzz.conditions.operators import operators_json, stored_operators
from vlafuzz.conditions.packs import has_packs, packs_json, stored_packs
from vlafuzz.errors import SceneError, UsageError, check_number, suggestion
from vlafuzz.execute.registry import Place, policy_at
from vlafuzz.objects import Pack, load_catalogue
from vlafuzz.plugins import source_digest
from vlafuzz.policies.base import Policy
from vlafuzz.policies.registry import check_policy_name
from vlafuzz.renderer import probe
from vlafuzz.rigs.rig import Rig
from vlafuzz.rigs.robots import PANDA, rig
from vlafuzz.scene import Scene, check_placement
from vlafuzz.search.base import Strategy
from vlafuzz.search.pool import InOrder, Pool
from vlafuzz.search.registry import POOL, Factory, strategy_factory
from vlafuzz.search.selection import Selection
from vlafuzz.space import OperatorSet, SearchSpace, load_operators
from vlafuzz.space.operators import CameraOrientation, CameraPosition
from vlafuzz.store.records import FLAGS, Manifest
from vlafuzz.store.store import Store
from vlafuzz.tasks.base import Task
from vlafuzz.tasks.tabletop import task as find_task

BUDGET = 100  # rollouts
STRATEGY = "surrogate"  # what finds most distinct cells: scripts/bench_strategies.py
MOST = 2**63 - 1  # what stores hold
CRITERIA = ("strict", "published")
_CAMERA = {CameraPosition.name, CameraOrientation.name}
_ANEW = ("scenes", "pool", "workers", "executor", "address")  # what every command says anew


@dataclass(frozen=True)
class RunConfig:
    """What a user asks of a run.

    Attributes:
        task: None for the one that ``scenes`` are of, else pick-up.
        robot: the name of a rig; None for that of ``scenes``, else panda.
        policy: None for ``default_policy``.
        strategy: None for the scenes of a file in order, else surrogate.
        budget: in policy rollouts; None for all scenes of a file, else 100.
        batch: proposals that are asked for at once.
        repeats: rollouts a scene.
        criteria: what success means: ``strict`` as the task's words, or ``published``.
        placement: how objects come to lie: ``resting``, or ``published`` to drop them.
        operators: a file of ranges, or the name of a shipped one; None for tabletop.
        vary: operators that vary; none for all that the file varies.
        scenes: a file of scenes to run in place of generated ones.
        pool: a file of scenes from which the strategy chooses, each of them once at most.
        packs: of objects, which then stand in place of the built-in ones unless ``operators`` names those.
        store: None for ``runs/<task>-<policy>-<strategy>-<seed>.db``.
        workers, executor, address: see ``Place``.
    """

    task: str | None = None
    robot: str | None = None
    policy: str | None = None
    strategy: str | None = None
    budget: int | None = None
    seed: int = 0
    batch: int = 16
    repeats: int = 1
    stop_early: bool = False
    criteria: str = "strict"
    placement: str = "resting"
    operators: str | None = None
    vary: tuple[str, ...] = ()
    scenes: Path | None = None
    pool: Path | None = None
    packs: tuple[Pack, ...] = ()
    store: Path | None = None
    workers: int = 1
    executor: str | None = None
    address: str | None = None
    command: str = ""


@dataclass(frozen=True, eq=False)
class Plan:
    """A run that can be started, or with ``resume`` a stored one that can be gone on with."""

    manifest: Manifest
    task: Task
    space: Space
    embed: Embed
    strategy: Strategy
    policy: Policy
    store: Path
    patience: int | None
    place: Place
    resume: int | None = None


def plan(config: RunConfig, operators: OperatorSet | None = None, policy: Policy | None = None) -> Plan:
    """Check what the user asks for and make everything but simulator and store.

    Args:
        operators: in place of those that the user names.
        policy: the one that the user names, made already.

    Raises:
        UsageError: a name, number or file is wrong.
    """
    _check_numbers(config)
    place = Place(config.workers, config.executor, config.address)
    place.check()
    scenes = read_scene_file(config.scenes, config.pool)
    task, setup = _task(config, scenes), _rig(config, scenes)
    policy_name = config.policy or default_policy(setup)
    strategy_name = _strategy_name(config)
    factory = None if config.scenes else strategy_factory(strategy_name)
    check_policy_name(policy_name)
    catalogue = load_catalogue(packs=config.packs)
    space = SearchSpace(operators or _operators(config, setup), catalogue, task.name, setup.robot)
    budget = config.budget or (len(scenes) * config.repeats if config.scenes else BUDGET)
    strategy = _strategy(factory, space, scenes, config.seed, budget // config.repeats)
    policy = policy or policy_at(place, policy_name)
    return Plan(
        manifest=_manifest(
            replace(config, policy=policy_name, strategy=strategy_name, budget=budget),
            space,
            policy,
            scene_file_json(config.scenes, config.pool, scenes),
        ),
        task=task,
        space=Pool(scenes, space) if scenes else space,
        embed=space.embed,
        strategy=strategy,
        policy=policy,
        store=config.store or default_store(task.name, policy_name, strategy_name, config.seed),
        patience=None if scenes else PATIENCE,  # a file of scenes ends by itself, fair or not
        place=place,
    )


def resume(flags: Mapping[str, Any]) -> Plan:
    """The newest run of a store that ended early and has what is given; all else is as it was stored.

    Args:
        flags: the fields of a ``RunConfig`` that the user gives.

    Raises:
        UsageError: no stored run fits, several do, or it cannot be gone on with here.
    """
    asked = RunConfig(**flags)
    scenes = read_scene_file(asked.scenes, asked.pool)
    task, strategy = _task(asked, scenes), _strategy_name(asked)
    policy = asked.policy or default_policy(_rig(asked, scenes))
    store = asked.store or default_store(task.name, policy, strategy, asked.seed)
    wanted = dict(flags) | ({"strategy": strategy} if asked.scenes else {})
    with Store.open(store) as opened:
        run = unfinished(opened, lambda manifest: _misfit(wanted, manifest))
    stored = {name: getattr(run.manifest, name) for name in FLAGS}
    anew = {name: getattr(asked, name) for name in _ANEW}
    if not scenes:
        anew |= stored_flag(run.manifest)
    known = RunConfig(**stored, **anew, packs=stored_packs(run.manifest), store=store)
    made = plan(known, stored_operators(store, run.manifest))
    check_scene_file(store, run.id, run.manifest, made.manifest)
    check_version(store, run, made.manifest)
    return replace(made, manifest=run.manifest, resume=run.id)


def default_policy(setup: Rig = PANDA) -> str:
    """The learned one where pictures of its robot can be made, else the one that needs physics only."""
    return "mini" if setup is PANDA and probe().works else "pinhole"


def default_store(task: str, policy: str, strategy: str, seed: int) -> Path:
    """Where a run is kept unless told otherwise; a name's awkward characters become dashes."""
    name = f"{task}-{policy}-{strategy}-{seed}"
    return Path("runs") / ("".join(c if c.isalnum() or c in "._-" else "-" for c in name) + ".db")


def _check_numbers(config: RunConfig) -> None:
    check_number("--repeats", config.repeats, 1, MOST)
    check_number("--budget", config.budget, config.repeats, MOST)
    check_number("--batch", config.batch, 1, MOST)
    check_number("--seed", config.seed, 0, MOST)
    check_placement(config.placement)
    if config.criteria not in CRITERIA:
        raise UsageError(f"unknown criteria {config.criteria!r}", hint=suggestion(config.criteria, CRITERIA))


def _task(config: RunConfig, scenes: Sequence[Scene]) -> Task:
    wanted = config.task or (scenes[0].task if scenes else "pick-up")
    for number, scene in enumerate(scenes, start=1):
        if scene.task != wanted:
            raise SceneError(
                f"{config.scenes or config.pool}: scene {number} is of task {scene.task!r}, not {wanted!r}",
                hint="a run has one task: split the file, or leave out --task",
            )
    return find_task(wanted)


def _rig(config: RunConfig, scenes: Sequence[Scene]) -> Rig:
    """The robot's, whose files are there."""
    setup = rig(config.robot or (scenes[0].robot if scenes else PANDA.robot))
    for number, scene in enumerate(scenes, start=1):
        if scene.robot != setup.robot:
            raise SceneError(
                f"{config.scenes or config.pool}: scene {number} is for {scene.robot!r}, not {setup.robot!r}",
                hint="a run has one robot: split the file, or leave out --robot",
            )
    if setup.urdf:
        assets.need(f"robots/{setup.urdf}", f"--robot {setup.robot}")
    for photo in setup.photos.values():
        assets.need(f"overlays/{photo}", f"--robot {setup.robot}")
    return setup


def _strategy_name(config: RunConfig) -> str:
    if config.scenes is None:
        return config.strategy or STRATEGY
    if config.strategy not in (None, POOL):
        raise UsageError(
            f"--scenes: strategy {config.strategy!r} makes its own scenes",
            hint="--pool lets it choose from the file",
        )
    return POOL


def _strategy(
    factory: Factory | None, space: SearchSpace, scenes: Sequence[Scene], seed: int, budget: int
) -> Strategy:
    """What proposes: scenes of its own, of a pool, or those of a file in order."""
    if factory is None:
        return InOrder(len(scenes))
    return Selection(factory, space, scenes, seed, budget) if scenes else factory(space, seed, budget)


def _operators(config: RunConfig, setup: Rig) -> OperatorSet:
    operators = load_operators(config.operators or setup.operators)
    if config.vary:
        return operators.only(config.vary)
    # A photo fits one view only.
    return operators.only(set(operators.varied) - _CAMERA) if setup.photos else operators


def _manifest(config: RunConfig, space: SearchSpace, policy: Policy, given: str) -> Manifest:
    """``config``: with policy, strategy and budget filled in."""
    assert config.policy
    assert config.strategy
    assert config.budget
    versions, operators = provenance.versions(), space.operators
    return Manifest(
        task=space.task.name,
        robot=space.rig.robot,
        policy=config.policy,
        spec=json.dumps(asdict(policy.spec), sort_keys=True),
        source=source_digest(config.policy),
        given=given,
        strategy=config.strategy,
        budget=config.budget,
        batch=config.batch,
        seed=config.seed,
        repeats=config.repeats,
        criteria=config.criteria,
        placement=config.placement,
        stop_early=config.stop_early,
        min_distance=operators.min_distance,
        operators=operators_json(operators),
        operators_digest=operators.digest,
        catalogue_digest=space.catalogue.digest,
        packs=packs_json(config.packs),
        simulator=provenance.simulator(versions),
        versions=versions,
        commit=provenance.commit(),
        command=config.command,
    )


def _misfit(flags: Mapping[str, Any], manifest: Manifest) -> str | None:
    """The first flag that asks for something else, in words."""
    for name in FLAGS:
        stored = getattr(manifest, name)
        if flags.get(name, stored) != stored:
            return f"{name} {stored}, not {flags[name]}"
    if "packs" in flags and not has_packs(manifest, flags["packs"]):
        return "other packs of objects"
    if "operators" in flags or "vary" in flags:
        named = RunConfig(operators=flags.get("operators"), vary=flags.get("vary", ()))
        asked = _operators(named, rig(manifest.robot))
        if asked.in_task(manifest.task).digest != manifest.operators_digest:
            return "other operators, or other ranges"
    return None
