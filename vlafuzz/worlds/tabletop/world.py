"""The tabletop: VLATest's tasks on ManiSkill. It is the default, and its simulator is loaded last."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from vlafuzz.common import assets
from vlafuzz.model.conditions import Conditions
from vlafuzz.model.evidence import Solver
from vlafuzz.model.scene import Scene
from vlafuzz.model.space import Space
from vlafuzz.model.task import Task
from vlafuzz.policies.base import Policy
from vlafuzz.policies.mini.policy import mini
from vlafuzz.worlds.base import Demonstrator, Stills, TryingPolicy, Wanted
from vlafuzz.worlds.evaluator import SceneEvaluator
from vlafuzz.worlds.manipulation.operator_set import stored_operators
from vlafuzz.worlds.manipulation.rigs.robots import PANDA, RIGS, rig
from vlafuzz.worlds.manipulation.table_world import TableWorld
from vlafuzz.worlds.provenance import versions
from vlafuzz.worlds.tabletop.capabilities import TabletopCapabilities
from vlafuzz.worlds.tabletop.experts.expert import Expert
from vlafuzz.worlds.tabletop.experts.pinhole import Pinhole
from vlafuzz.worlds.tabletop.experts.seeing import SeeingExpert
from vlafuzz.worlds.tabletop.objects import load_catalogue
from vlafuzz.worlds.tabletop.objects.catalogue import packs_json, stored_catalogue
from vlafuzz.worlds.tabletop.objects.packs import packs_of
from vlafuzz.worlds.tabletop.renderer import begin_probe, check_renderer, in_use, probe_once
from vlafuzz.worlds.tabletop.space import OperatorSet, SearchSpace
from vlafuzz.worlds.tabletop.tasks import TASKS, task

if TYPE_CHECKING:
    from vlafuzz.policies.clients.interface import Interface
    from vlafuzz.worlds.recording import Recording


class Tabletop(TabletopCapabilities, TableWorld):
    """The world of VLATest's tasks."""

    usual = True
    tasks, robots = tuple(TASKS), tuple(RIGS)
    policies: ClassVar[Mapping[str, Callable[..., Policy]]] = {
        "mini": mini,
        "pinhole": Pinhole,
        "expert": Expert,
        "seeing": SeeingExpert,
    }

    @property
    def objects(self) -> tuple[str, ...]:
        return load_catalogue().names()

    @property
    def simulator(self) -> str:
        installed = versions()
        return "/".join(
            f"{package} {installed.get(package)}" for package in ("vlafuzz", "mani_skill", "sapien")
        )

    def renderer(self) -> str:
        return in_use()

    def has(self, task: str) -> bool:
        return task in TASKS

    def task(self, name: str) -> Task:
        return task(name)

    def default_policy(self, robot: str) -> str:
        """``mini`` where its robot's pictures can be rendered, else ``pinhole``, which needs physics only."""
        return "mini" if robot == PANDA.robot and probe_once().works else "pinhole"

    def begin_early(self, policy: str | None) -> None:
        if policy in (None, "mini"):
            begin_probe()

    def preload(self) -> None:
        import vlafuzz.worlds.tabletop.sim.evaluator  # noqa: F401

    def conditions_of(self, scene: Scene) -> dict[str, str]:
        """The packs that its objects are from."""
        return {"packs": packs_json(packs_of(placement.object for placement in scene.placements))}

    def check_pictures(self) -> None:
        check_renderer()

    def space_of(self, wanted: Wanted, operators: OperatorSet) -> SearchSpace:
        setup = rig(wanted.robot)
        if setup.urdf:
            assets.need(f"robots/{setup.urdf}", f"--robot {setup.robot}")
        for photo in setup.photos.values():
            assets.need(f"overlays/{photo}", f"--robot {setup.robot}")
        return SearchSpace(operators, load_catalogue(packs=wanted.packs), wanted.task, wanted.robot)

    def stored_space(
        self, source: Path, conditions: Conditions, vary: Collection[str] | None = None
    ) -> SearchSpace:
        operators = stored_operators(source, conditions, vary)
        return SearchSpace(operators, stored_catalogue(conditions), conditions.task, conditions.robot)

    def evaluator(
        self,
        conditions: Conditions,
        policy: Policy,
        space: Space | None,
        *,
        recording: Recording | None,
        checked: bool,
    ) -> SceneEvaluator:
        from vlafuzz.worlds.tabletop.sim.evaluator import ManiSkillEvaluator

        catalogue = space.catalogue if isinstance(space, SearchSpace) else stored_catalogue(conditions)
        return ManiSkillEvaluator(conditions, policy, catalogue, recording=recording, checked=checked)

    def solvers(self) -> Mapping[Solver, TryingPolicy]:
        return {"expert": Expert(), "seeing": SeeingExpert()}

    def demonstrator(self, interface: Interface) -> Demonstrator:
        from vlafuzz.worlds.tabletop.sim.demonstrator import TabletopDemonstrator

        return TabletopDemonstrator(interface)

    def stills(self, conditions: Conditions, space: Space) -> Stills:
        from vlafuzz.worlds.tabletop.sim.evaluator import Stills

        assert isinstance(space, SearchSpace)
        return Stills(conditions.task, space.catalogue, placement=conditions.placement)


WORLD = Tabletop()
