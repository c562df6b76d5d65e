"""A scene as read back from the simulator, to be checked against the requested one.

VLATest's environments ignored the light in three of four tasks, and nobody noticed; here any difference is an
error.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import sapien

from vlafuzz.errors import SimulatorError
from vlafuzz.rigs.camera import camera_pose
from vlafuzz.rigs.rig import Rig
from vlafuzz.scene import Scene

METRES = 1e-5
TURN = 1e-4  # of a quaternion's components


@dataclass(frozen=True, eq=False)
class Applied:
    """What the simulator contains. ``light`` is the factor on the nominal lights."""

    instruction: str
    objects: tuple[str, ...]
    poses: tuple[sapien.Pose, ...]
    light: float
    camera: sapien.Pose

    def as_dict(self) -> dict[str, Any]:
        """Plain numbers, for ``info``."""
        return {
            "instruction": self.instruction,
            "objects": [
                {"name": name, "position": pose.p.tolist(), "quaternion": pose.q.tolist()}
                for name, pose in zip(self.objects, self.poses, strict=True)
            ],
            "light": self.light,
            "camera": {"position": self.camera.p.tolist(), "quaternion": self.camera.q.tolist()},
        }

    def check(self, scene: Scene, poses: Sequence[sapien.Pose], rig: Rig) -> None:
        """Compare with the requested scene, before the first step.

        Args:
            poses: requested poses of the objects.

        Raises:
            SimulatorError: an option was not applied.
        """
        if self.objects != tuple(placement.object for placement in scene.placements):
            _fail("objects", [placement.object for placement in scene.placements], self.objects)
        for name, expected, actual in zip(self.objects, poses, self.poses, strict=True):
            _check_pose(name, expected, actual)
        if abs(self.light - scene.light.intensity) > 1e-4 * scene.light.intensity:
            _fail("light", scene.light.intensity, self.light)
        view = camera_pose(rig.view, scene.camera)
        _check_pose("camera", sapien.Pose(view.position, view.quaternion), self.camera)
        if self.instruction != scene.instruction:
            _fail("instruction", scene.instruction, self.instruction)


def _check_pose(name: str, expected: sapien.Pose, actual: sapien.Pose) -> None:
    distance = float(np.abs(expected.p - actual.p).max())
    turn = float(min(np.abs(expected.q - actual.q).max(), np.abs(expected.q + actual.q).max()))
    if not (distance <= METRES and turn <= TURN):
        _fail(f"pose of {name}", expected, actual)


def _fail(part: str, expected: object, actual: object) -> None:
    raise SimulatorError(
        f"{part}: asked for {expected}, the simulator has {actual}", hint="this is a bug in vlafuzz"
    )
