"""A scene as read back from the simulator, to be checked against the requested one.

VLATest's environments ignored the light in three of four tasks, and nobody noticed; here any difference is an
error.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import sapien

from vlafuzz.errors import SimulatorError
from vlafuzz.model.scene import EXTRAS, Scene
from vlafuzz.worlds.manipulation.rigs.camera import camera_pose
from vlafuzz.worlds.manipulation.rigs.rig import Rig

METRES = 1e-5
TURN = 1e-4  # of a quaternion's components


@dataclass(frozen=True, eq=False, kw_only=True)
class Applied:
    """What the simulator contains, read back from it.

    Attributes:
        light: factor on the nominal lights.
        extras: the parts of the scene that extra operators vary, by field name, as far as they are in effect.
    """

    instruction: str
    objects: tuple[str, ...]
    poses: tuple[sapien.Pose, ...]
    light: float
    camera: sapien.Pose
    extras: Mapping[str, Any]

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
            **{part: asdict(value) for part, value in self.extras.items()},
        }

    def check(self, scene: Scene, poses: Sequence[sapien.Pose], rig: Rig) -> None:
        """Compare with the requested scene and poses of its objects, before the first step.

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
        for part in EXTRAS:
            expected, actual = getattr(scene, part), self.extras.get(part)
            if actual is None or not _alike(asdict(expected), asdict(actual)):
                _fail(part.replace("_", " "), expected, actual)


def _alike(expected: Mapping[str, Any], actual: Mapping[str, Any]) -> bool:
    """Whether two parts of scenes are equal up to the simulator's single precision."""
    return all(
        actual[field] == value
        if isinstance(value, str)
        else math.isclose(actual[field], value, rel_tol=1e-5, abs_tol=1e-4)
        for field, value in expected.items()
    )


def _check_pose(name: str, expected: sapien.Pose, actual: sapien.Pose) -> None:
    distance = float(np.abs(expected.p - actual.p).max())
    turn = float(min(np.abs(expected.q - actual.q).max(), np.abs(expected.q + actual.q).max()))
    if not (distance <= METRES and turn <= TURN):
        _fail(f"pose of {name}", expected, actual)


def _fail(part: str, expected: object, actual: object) -> None:
    raise SimulatorError(
        f"{part}: asked for {expected}, the simulator has {actual}", hint="this is a bug in vlafuzz"
    )
