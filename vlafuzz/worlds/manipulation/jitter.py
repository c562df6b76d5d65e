"""Jitter: scenes around a scene that nobody would call another one."""

import math
from dataclasses import astuple, replace
from functools import cache
from pathlib import Path
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy.spatial.transform import Rotation

from vlafuzz.common.assets import operators_dir
from vlafuzz.common.reading import read_yaml, validated
from vlafuzz.errors import CatalogueError
from vlafuzz.model.scene import Camera, InitialPose, Light, Placement, Scene
from vlafuzz.worlds.manipulation.base import Strict
from vlafuzz.worlds.manipulation.rigs import rig

_Amount = Annotated[float, Field(ge=0, allow_inf_nan=False, strict=False)]


class Jitter(Strict):
    """Half widths of uniform distributions about a scene's own values, and the pixel noise's deviation.

    Attributes:
        position: of each object's x and y, metres; ``yaw``: of each object, degrees. camera_position: along each axis,
        metres; ``camera_orientation``: about each axis, degrees. light: share of the intensity.
        pixel_noise: standard deviation in grey levels.
        joints: of each joint of the arm at the start, degrees.
    """

    position: _Amount
    yaw: _Amount
    camera_position: _Amount
    camera_orientation: _Amount
    light: _Amount
    pixel_noise: _Amount
    joints: _Amount

    def apply(self, scene: Scene, number: int) -> Scene:
        """The n-th scene around a scene: the same one for the same scene and number, on any machine."""
        rng = np.random.default_rng([int(scene.digest, 16), number])
        setup = rig(scene.robot)
        joints = np.array(astuple(scene.initial_pose))
        joints[: setup.arm_joints] += _uniform(rng, self.joints, setup.arm_joints)
        return replace(
            scene,
            targets=tuple(self._placed(rng, target) for target in scene.targets),
            confounders=tuple(self._placed(rng, confounder) for confounder in scene.confounders),
            light=Light(scene.light.intensity * (1 + float(rng.uniform(-self.light, self.light)))),
            camera=scene.camera if setup.photos else self._moved(rng, scene.camera),  # photos fit one view only
            noise=replace(scene.noise, grain=math.hypot(scene.noise.grain, self.pixel_noise)),
            initial_pose=InitialPose(**{f"j{index}": value for index, value in enumerate(joints.tolist(), 1)}),
        )

    def _placed(self, rng: np.random.Generator, placement: Placement) -> Placement:
        x, y = _uniform(rng, self.position, 2).tolist()
        turn = float(rng.uniform(-self.yaw, self.yaw))
        moved = replace(placement, x=placement.x + x, y=placement.y + y)
        if placement.quaternion is None:
            return replace(moved, yaw=placement.yaw + turn)
        upright = Rotation.from_euler("z", turn, degrees=True)
        turned = upright * Rotation.from_quat(placement.quaternion, scalar_first=True)
        w, i, j, k = turned.as_quat(scalar_first=True).tolist()
        return replace(moved, quaternion=(w, i, j, k))

    def _moved(self, rng: np.random.Generator, camera: Camera) -> Camera:
        x, y, z = (np.array(camera.offset) + _uniform(rng, self.camera_position, 3)).tolist()
        roll, pitch, yaw = _uniform(rng, self.camera_orientation, 3).tolist()
        return Camera(
            math.hypot(x, y, z),
            math.degrees(math.atan2(y, x)),
            math.degrees(math.atan2(z, math.hypot(x, y))),
            roll=camera.roll + roll,
            pitch=camera.pitch + pitch,
            yaw=camera.yaw + yaw,
        )


@cache
def load_jitter(path: Path | None = None) -> Jitter:
    """Read a file of amounts; by default the shipped one.

    Raises:
        CatalogueError: the file is wrong; the message names file and key.
    """
    path = path or operators_dir() / "jitter.yaml"
    hint = f"one number for each of {', '.join(Jitter.model_fields)}"
    return validated(Jitter, read_yaml(path, CatalogueError, hint), path, CatalogueError, hint)


def _uniform(rng: np.random.Generator, amount: float, size: int) -> NDArray[np.float64]:
    return rng.uniform(-amount, amount, size)
