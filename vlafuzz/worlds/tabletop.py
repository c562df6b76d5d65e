"""The tabletop: VLATest's tasks on ManiSkill. It is the default, and its simulator is loaded last."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from vlafuzz.conditions.conditions import Conditions
from vlafuzz.conditions.provenance import versions
from vlafuzz.evidence import Solver
from vlafuzz.objects import Catalogue
from vlafuzz.policies.base import Policy
from vlafuzz.policies.expert import Expert
from vlafuzz.policies.seeing import SeeingExpert
from vlafuzz.renderer import check_renderer, in_use, probe_once
from vlafuzz.rigs.robots import PANDA, RIGS
from vlafuzz.sim.evaluator import SceneEvaluator
from vlafuzz.space import OperatorSet, SearchSpace
from vlafuzz.tasks.base import Task
from vlafuzz.tasks.tabletop import task
from vlafuzz.worlds.base import Demonstrator, Stills, TryingPolicy

if TYPE_CHECKING:
    from vlafuzz.clients.interface import Interface
    from vlafuzz.sim.recording import Recording


class Tabletop:
    """A ``World``."""

    robots = tuple(RIGS)

    @property
    def simulator(self) -> str:
        installed = versions()
        return "/".join(
            f"{package} {installed.get(package)}" for package in ("vlafuzz", "mani_skill", "sapien")
        )

    def renderer(self) -> str:
        return in_use()

    def task(self, name: str) -> Task:
        return task(name)

    def default_policy(self, robot: str) -> str:
        """``mini`` where its robot's pictures can be rendered, else ``pinhole``, which needs physics only."""
        return "mini" if robot == PANDA.robot and probe_once().works else "pinhole"

    def check_pictures(self) -> None:
        check_renderer()

    def space(self, operators: OperatorSet, catalogue: Catalogue, task: str, robot: str) -> SearchSpace:
        return SearchSpace(operators, catalogue, task, robot)

    def evaluator(
        self,
        conditions: Conditions,
        policy: Policy,
        catalogue: Catalogue,
        *,
        recording: Recording | None,
        checked: bool,
    ) -> SceneEvaluator:
        from vlafuzz.sim.maniskill.evaluator import ManiSkillEvaluator

        return ManiSkillEvaluator(conditions, policy, catalogue, recording=recording, checked=checked)

    def solvers(self) -> Mapping[Solver, TryingPolicy]:
        return {"expert": Expert(), "seeing": SeeingExpert()}

    def demonstrator(self, interface: Interface) -> Demonstrator:
        from vlafuzz.sim.maniskill.demonstrator import TabletopDemonstrator

        return TabletopDemonstrator(interface)

    def stills(self, conditions: Conditions, catalogue: Catalogue) -> Stills:
        from vlafuzz.sim.maniskill.stills import Stills

        return Stills(conditions.task, catalogue, placement=conditions.placement)
