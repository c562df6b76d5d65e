"""What runs scenes of the tabletop on ManiSkill."""

from collections.abc import Sequence

from vlafuzz.model import Rejection, Scene
from vlafuzz.policies.base import CameraRequest
from vlafuzz.worlds.tabletop.evaluator import TabletopEvaluator
from vlafuzz.worlds.tabletop.sim.env import TabletopEnv
from vlafuzz.worlds.tabletop.sim.world import settled


class ManiSkillEvaluator(TabletopEvaluator):
    """Runs a policy in scenes of one task on ManiSkill."""

    def room(self, cameras: Sequence[CameraRequest], hz: int, robot: str, shown: str | None) -> TabletopEnv:
        return TabletopEnv(self._task.name, self.catalogue, cameras, hz, robot, shown)

    def settled(self, scene: Scene) -> Rejection | None:
        return settled(scene, self.catalogue)
