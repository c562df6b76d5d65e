"""The tabletop in MuJoCo: the same scenes, operators, experts and judgement, other contacts and another renderer.

What fails in both is hardly a simulator's own. MuJoCo is an extra, and is loaded when a scene is run.
"""

from collections.abc import Iterator
from importlib import metadata, util
from typing import Unpack

from vlafuzz import __version__
from vlafuzz.common.check import Check
from vlafuzz.errors import PrerequisiteError, UsageError
from vlafuzz.model import Conditions, Space
from vlafuzz.policies.base import Policy
from vlafuzz.worlds import opengl
from vlafuzz.worlds.evaluator import Options, SceneEvaluator
from vlafuzz.worlds.manipulation.rigs import PANDA
from vlafuzz.worlds.manipulation.space import TableWorld
from vlafuzz.worlds.tabletop.evaluator import TabletopEvaluator
from vlafuzz.worlds.tabletop.tasks import TASKS
from vlafuzz.worlds.tabletop.world import Tabletop

NAME = "tabletop-mujoco"
HINT = "pip install 'vlafuzz[mujoco]'"


class TabletopMujoco(Tabletop):
    """The tabletop's tasks, which have this world's name before them; the Panda only."""

    usual = False
    tasks, robots = tuple(f"{NAME}/{task}" for task in TASKS), (PANDA.robot,)
    settings = TableWorld.settings  # one quality of pictures

    @property
    def simulator(self) -> str:
        require()
        return f"vlafuzz {__version__}/mujoco {metadata.version('mujoco')}"

    def renderer(self) -> str:
        return f"{opengl.device()}, MuJoCo {metadata.version('mujoco')}"

    def has(self, task: str) -> bool:
        return task in self.tasks

    def default_policy(self, robot: str) -> str:
        return "mini" if opengl.device() else "pinhole"

    def simulated(self) -> type[TabletopEvaluator]:
        require()
        from vlafuzz.worlds.tabletop_mujoco.env import MujocoEvaluator

        return MujocoEvaluator

    def check_pictures(self) -> None:
        require()
        if not opengl.device():
            hint = "apt install libegl1 libgl1-mesa-dri, or a GPU's driver"
            raise PrerequisiteError(f"pictures of {NAME} need OpenGL with EGL, which does not draw here", hint)

    def evaluator(
        self, conditions: Conditions, policy: Policy, space: Space | None, **options: Unpack[Options]
    ) -> SceneEvaluator:
        require()
        if conditions.robot not in self.robots:
            raise UsageError(f"robot {conditions.robot}: {NAME} has none but the {PANDA.robot}", hint="leave it out")
        return super().evaluator(conditions, policy, space, **options)

    def machine(self) -> Iterator[Check]:
        there = util.find_spec("mujoco") is not None
        drawn = opengl.device() or "no OpenGL with EGL draws pictures here"
        version = metadata.version("mujoco") if there else "not installed"
        yield Check("mujoco", version, "ok", drawn if there else f"only {NAME} needs it: {HINT}")


def require() -> None:
    """Raise a PrerequisiteError if MuJoCo is not installed."""
    if util.find_spec("mujoco") is None:
        raise PrerequisiteError(f"{NAME} needs MuJoCo, which is not installed", hint=HINT)


WORLD = TabletopMujoco()
