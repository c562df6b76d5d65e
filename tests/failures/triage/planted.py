"""Policies that fail exactly when planted conditions hold, judged without a simulator."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from tests.search.worlds import Remembering
from vlafuzz.failures.triage.certify import Certifier, Shrunk
from vlafuzz.failures.triage.oracle import Jitter, Oracle
from vlafuzz.failures.triage.shrink import Reference, Shrinker
from vlafuzz.model import Scene, Verdict
from vlafuzz.store.records import Judged
from vlafuzz.worlds.manipulation.extras import EXTRAS
from vlafuzz.worlds.manipulation.operators import OPERATORS
from vlafuzz.worlds.manipulation.space import GROUPS
from vlafuzz.worlds.tabletop.fairness import check_static
from vlafuzz.worlds.tabletop.objects import load_catalogue
from vlafuzz.worlds.tabletop.space import SearchSpace, load_operators

STAGES = ("grasp", "lift", "success")
CATALOGUE = load_catalogue()
SPACE = Remembering(load_operators().only(OPERATORS.keys() - EXTRAS), CATALOGUE, "pick-up")
WITH_EXTRAS = Remembering(
    load_operators().only(OPERATORS.keys() - {"newcomer", "target-knock", "target-switch"}), CATALOGUE, "pick-up"
)

Condition = Callable[[Scene], bool]

# Of each operator several conditions that do not hold at nominal.
CONDITIONS: dict[str, tuple[Condition, ...]] = {
    "target-position": (
        lambda scene: scene.targets[0].x > 0.02,
        lambda scene: scene.targets[0].y < -0.08,
        lambda scene: abs(scene.targets[0].y) > 0.1 and scene.targets[0].x < -0.08,
    ),
    "target-orientation": (
        lambda scene: abs(scene.targets[0].yaw) > 40,
        lambda scene: scene.targets[0].rest != SPACE.nominal(like=scene).targets[0].rest,
    ),
    "confounders": (
        lambda scene: len(scene.confounders) > 0,
        lambda scene: len(scene.confounders) > 1,
        lambda scene: any(each.y > 0.1 for each in scene.confounders),
    ),
    "light": (lambda scene: scene.light.intensity < 0.4, lambda scene: scene.light.intensity > 3),
    "camera-position": (lambda scene: scene.camera.distance > 0.02,),
    "camera-orientation": (
        lambda scene: scene.camera.yaw > 2.5,
        lambda scene: scene.camera.roll < -1 and scene.camera.pitch > 1.05,
    ),
    "wording": (lambda scene: scene.instruction != SPACE.nominal(like=scene).instruction,),
}
DARK, TILTED = CONDITIONS["light"][0], CONDITIONS["camera-orientation"][0]
EXTRA_CONDITIONS: dict[str, Condition] = {
    "backdrop": lambda scene: scene.backdrop.table == "checker",
    "initial-pose": lambda scene: scene.initial_pose.j2 > 1,
    "sensor-noise": lambda scene: scene.noise.blur > 1,
    "control-latency": lambda scene: scene.latency.delay > 1,
    "exposure": lambda scene: scene.exposure.auto > 0.55,
    "target-slide": lambda scene: scene.target_slide.distance > 0.04,
    "camera-bump": lambda scene: scene.camera_bump.pitch > 2,
    "light-switch": lambda scene: scene.light_switch.intensity < 0.4 and scene.light_switch.when == "grasp",
    "picture-loss": lambda scene: scene.picture_loss.duration > 6,
    "control-stall": lambda scene: scene.control_stall.duration > 3,
    "grip-slip": lambda scene: scene.grip_slip.duration > 1 and scene.grip_slip.when == "carry",
    "target-topple": lambda scene: scene.target_topple.rest == "lying",
    "grip-weak": lambda scene: scene.grip_weak.force < 0.5 and scene.grip_weak.when == "carry",
    "instruction-change": lambda scene: scene.instruction_change.to != "same",
}
# Which the tabletop lacks, or a task of one target; a newcomer is nothing without confounders.
ELSEWHERE = {"initial-state", "bystander-position", "bystander-orientation", "goal-slide", "newcomer"}
ELSEWHERE |= {"target-knock", "target-switch"}
assert CONDITIONS.keys() | EXTRA_CONDITIONS.keys() == GROUPS.keys() - ELSEWHERE


@dataclass
class Planted:
    """A judge: loses the grasp when all conditions hold. It counts, and notes what was not fair."""

    conditions: Sequence[Condition]
    lost: str = "grasp"
    space: SearchSpace = SPACE
    asked: list[Scene] = field(default_factory=list)
    rollouts: int = 0

    def __call__(self, scenes: Sequence[Scene], numbers: Sequence[int]) -> list[Judged]:
        self.asked += scenes
        return [self.judged(scene) for scene in scenes]

    def judged(self, scene: Scene) -> Judged:
        if check_static(scene, CATALOGUE, SPACE.operators.min_distance):
            return Judged(Verdict.INVALID)
        self.rollouts += 1
        if self.fails(scene):
            return Judged(Verdict.FAILED, self.lost, 1)
        return Judged(Verdict.PASSED, None, 1)

    def fails(self, scene: Scene) -> bool:
        return all(condition(scene) for condition in self.conditions)

    def oracle(self, most: int = 300, jitter: Jitter | None = None) -> Oracle:
        oracle = Oracle(self, STAGES, jitter, budget=most, lead=1)
        oracle.count_up_to(self.lost)
        return oracle

    def shrunk(self, scene: Scene, oracle: Oracle | None = None) -> Shrunk:
        """What is left of a scene, certified."""
        oracle = oracle or self.oracle()
        way = Shrinker(self.space, oracle, [scene]).shrink()
        return Certifier(oracle, self.space, Reference(None, STAGES)).certify(way)

    def finding(self, seed: int) -> Scene:
        """A random scene in which it fails."""
        rng = np.random.default_rng(seed)
        return next(scene for scene in iter(lambda: self.space.sample(rng), None) if self.fails(scene))


def fair(scene: Scene) -> bool:
    return check_static(scene, CATALOGUE, SPACE.operators.min_distance) is None


# Conditions on one value each: operator, where it stands, its first value that fails, a grid step.
EDGES: tuple[tuple[str, str, float, float, Condition], ...] = (
    ("camera-orientation", "camera.yaw", 2.6, 0.1, lambda scene: scene.camera.yaw > 2.5),
    ("camera-orientation", "camera.pitch", -1.6, 0.1, lambda scene: scene.camera.pitch < -1.5),
    ("camera-position", "camera.distance", 0.021, 0.001, lambda scene: scene.camera.distance > 0.02),
    ("target-position", "targets.0.x", 0.021, 0.001, lambda scene: scene.targets[0].x > 0.02),
    ("target-position", "targets.0.y", -0.081, 0.001, lambda scene: scene.targets[0].y < -0.08),
    ("target-orientation", "targets.0.yaw", 41, 1, lambda scene: scene.targets[0].yaw > 40),
    ("light", "light.intensity", 2**-1.35, 2**-1.35 / 25, lambda scene: scene.light.intensity < 0.4),
)
