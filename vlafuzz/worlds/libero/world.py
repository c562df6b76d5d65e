"""LIBERO's tasks on robosuite. Its packages are an extra, and nothing of them is loaded before it is used."""

import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, Unpack

from vlafuzz import __version__
from vlafuzz.errors import UsageError
from vlafuzz.model import Conditions, Solver, Space, Task
from vlafuzz.policies.base import Policy
from vlafuzz.policies.clients.model import Interface
from vlafuzz.policies.mini.policy import SHIPPED, Mini
from vlafuzz.worlds import opengl
from vlafuzz.worlds.base import Demonstrator, Prompt, SceneMap, TryingPolicy
from vlafuzz.worlds.evaluator import Options, SceneEvaluator
from vlafuzz.worlds.libero.expert import LiberoDemonstrator, LiberoExpert
from vlafuzz.worlds.libero.packages import require, versions
from vlafuzz.worlds.libero.pictures import QUALITY
from vlafuzz.worlds.libero.space import LiberoSpace
from vlafuzz.worlds.libero.stages import task
from vlafuzz.worlds.libero.suites import SUITES, find_task, find_tasks
from vlafuzz.worlds.manipulation.operator_set import OperatorSet, stored_operators
from vlafuzz.worlds.manipulation.rigs import LIBERO
from vlafuzz.worlds.manipulation.space import TableWorld, maps_of_targets


def mini_libero() -> Mini:
    """Mini with two cameras, trained in the ten tasks of LIBERO's object suite; it runs on a CPU."""
    return Mini(SHIPPED / "libero")


class Libero(TableWorld):
    """The world of LIBERO; its tasks are named ``SUITE/NUMBER``."""

    robots = (LIBERO.robot,)
    settings = (*TableWorld.settings, QUALITY)
    tasks = tuple(f"{suite}/{number}" for suite in SUITES for number in range(10))
    policies: ClassVar[Mapping[str, Callable[..., Policy]]] = {
        "libero-expert": LiberoExpert,
        "mini-libero": mini_libero,
    }

    @property
    def simulator(self) -> str:
        mujoco, robosuite, libero = versions()
        return f"vlafuzz {__version__}/mujoco {mujoco}/robosuite {robosuite}/libero {libero}"

    def renderer(self) -> str:
        found, drawn = versions(), opengl.device()
        return f"{drawn}, MuJoCo {found.mujoco}, robosuite {found.robosuite}" if drawn else ""

    def has(self, task: str) -> bool:
        return task.startswith("libero") and "/" in task

    def task(self, name: str) -> Task:
        return task(name)

    def maps(self, task: str) -> list[SceneMap]:
        return maps_of_targets(find_task(task).concerned, "is moved")

    def suite(self, name: str) -> Sequence[str]:
        is_suite = name.startswith("libero") and "/" not in name
        return [str(of) for of in find_tasks(name)] if is_suite else super().suite(name)

    def prompts(self, suite: str = "") -> Iterable[Prompt]:
        """Return what the tasks of a suite, or of all four usual ones, tell a policy."""
        for name in [suite] if suite else SUITES:
            for of in [find_task(name)] if "/" in name else find_tasks(name):
                named = {*of.things, *of.interest, *(thing for atom in of.goal for thing in atom[1:])}
                carried = [atom for atom in of.initial if atom[1] in of.carried]  # suites vary where it is, too
                yield Prompt(
                    task=str(of),
                    words=of.instruction,
                    things=_spoken(sorted(named)),
                    wanted=_spoken(of.carried),
                    goal=f"{sorted(of.goal)} from {sorted(carried)}",
                )

    def default_policy(self, robot: str) -> str:
        hint = "--policy mini-libero for libero_object, or your model: openpi:ws://localhost:8000?profile=libero"
        raise UsageError("LIBERO's scenes have no default policy", hint=hint)

    def check_pictures(self) -> None:
        require()

    def space_of(self, task: str, robot: str, operators: OperatorSet, packs: Sequence[Any]) -> LiberoSpace:
        return LiberoSpace(operators, task, robot)

    def stored_space(self, source: Path, conditions: Conditions, vary: Collection[str] | None = None) -> LiberoSpace:
        return LiberoSpace(stored_operators(source, conditions, vary), conditions.task, conditions.robot)

    def evaluator(
        self, conditions: Conditions, policy: Policy, space: Space | None, **options: Unpack[Options]
    ) -> SceneEvaluator:
        from vlafuzz.worlds.libero.evaluator import LiberoEvaluator

        return LiberoEvaluator(conditions, policy, **options)

    def solvers(self) -> Mapping[Solver, TryingPolicy]:
        return {"expert": LiberoExpert()}

    def demonstrator(self, interface: Interface) -> Demonstrator:
        return LiberoDemonstrator(interface)


def _spoken(names: Iterable[str]) -> tuple[str, ...]:
    """Things' names in words: ``akita_black_bowl_1`` is an akita black bowl."""
    return tuple(dict.fromkeys(re.sub(r"_\d+$", "", name).replace("_", " ") for name in names))


WORLD = Libero()
