"""LIBERO's tasks on robosuite. Its packages are an extra, and nothing of them is loaded before it is used."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from vlafuzz import __version__
from vlafuzz.conditions.conditions import Conditions
from vlafuzz.errors import UsageError
from vlafuzz.evidence import Solver
from vlafuzz.objects import Catalogue
from vlafuzz.policies.base import Policy
from vlafuzz.rigs.robots import OF_LIBERO
from vlafuzz.sim.evaluator import SceneEvaluator
from vlafuzz.sim.libero.expert.policy import LiberoExpert
from vlafuzz.sim.libero.packages import require, versions
from vlafuzz.sim.libero.pictures.opengl import opengl
from vlafuzz.sim.libero.scenes.space import LiberoSpace
from vlafuzz.sim.libero.tasks import task
from vlafuzz.space import OperatorSet, SearchSpace
from vlafuzz.tasks.base import Task
from vlafuzz.worlds.base import Demonstrator, Stills, TryingPolicy

if TYPE_CHECKING:
    from vlafuzz.clients.interface import Interface
    from vlafuzz.sim.recording import Recording


class Libero:
    """A ``World``; its tasks are named ``SUITE/NUMBER``."""

    robots = tuple(OF_LIBERO)

    @property
    def simulator(self) -> str:
        found = versions()
        return (
            f"vlafuzz {__version__}/mujoco {found.mujoco}/robosuite {found.robosuite}/libero {found.libero}"
        )

    def renderer(self) -> str:
        return opengl()

    def task(self, name: str) -> Task:
        return task(name)

    def default_policy(self, robot: str) -> str:
        hint = (
            "--policy mini-libero for libero_object, or your model: openpi:ws://localhost:8000?profile=libero"
        )
        raise UsageError("LIBERO's scenes have no default policy", hint=hint)

    def check_pictures(self) -> None:
        require()

    def space(self, operators: OperatorSet, catalogue: Catalogue, task: str, robot: str) -> SearchSpace:
        return LiberoSpace(operators, catalogue, task, robot)

    def evaluator(
        self,
        conditions: Conditions,
        policy: Policy,
        catalogue: Catalogue,
        *,
        recording: Recording | None,
        checked: bool,
    ) -> SceneEvaluator:
        from vlafuzz.sim.libero.evaluator import LiberoEvaluator

        return LiberoEvaluator(conditions, policy, recording=recording, checked=checked)

    def solvers(self) -> Mapping[Solver, TryingPolicy]:
        return {"expert": LiberoExpert()}

    def demonstrator(self, interface: Interface) -> Demonstrator:
        from vlafuzz.sim.libero.expert.demonstrator import LiberoDemonstrator

        return LiberoDemonstrator(interface)

    def stills(self, conditions: Conditions, catalogue: Catalogue) -> Stills:
        from vlafuzz.sim.libero.evaluator import LiberoStills

        return LiberoStills(conditions.task)
