"""What the simulator has of a scene, to be checked against what was asked for.

VLATest's environments ignored the light in three of four tasks, and nobody noticed: here a difference is
an error.
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
    """Read back from the simulator: objects, their poses, the lights' factor, camera pose, instruction."""

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
        """Compare with the scene that was asked for, before the first step.

        Args:
            poses: of the objects, as they were to be put.

        Raises:
            SimulatorError: an option was not applied.
        """
        if self.objects != tuple(placement.object for placement in scene.placements):
            _complain("objects", [placement.object for placement in scene.placements], self.objects)
        for name, asked, pose in zip(self.objects, poses, self.poses, strict=True):
            _check_pose(name, asked, pose)
        if abs(self.light - scene.light.intensity) > 1e-4 * scene.light.intensity:
            _complain("light", scene.light.intensity, self.light)
        view = camera_pose(rig.view, scene.camera)
        _check_pose("camera", sapien.Pose(view.position, view.quaternion), self.camera)
        if self.instruction != scene.instruction:
            _complain("instruction", scene.instruction, self.instruction)


def _check_pose(what: str, asked: sapien.Pose, got: sapien.Pose) -> None:
    apart = float(np.abs(asked.p - got.p).max())
    turned = float(min(np.abs(asked.q - got.q).max(), np.abs(asked.q + got.q).max()))
    if not (apart <= METRES and turned <= TURN):
        _complain(f"pose of {what}", asked, got)


def _complain(what: str, asked: object, got: object) -> None:
    raise SimulatorError(
        f"{what}: asked for {asked}, the simulator has {got}", hint="this is a bug in vlafuzz"
    )
