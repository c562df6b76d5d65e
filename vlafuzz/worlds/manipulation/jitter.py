"""Jitter: scenes around a scene that nobody would call another one.

A failure counts as firm when the policy mostly fails in the scenes around it: each of them is what a person who sets
the scene up again, with a ruler and on another machine, would call the same scene. The amounts are the ends of uniform
distributions about the scene's own values, except for the pixel noise.
"""

import math
from dataclasses import astuple, replace

import numpy as np
from scipy.spatial.transform import Rotation

from vlafuzz.model import Camera, InitialPose, Light, Placement, Scene
from vlafuzz.worlds.manipulation.rigs import rig

POSITION = 0.001  # metres, x and y of each object: a careful hand with a template does not do better
YAW = 1.0  # degrees, each object: the edge of a can turned by 0.5 mm
CAMERA_POSITION = 0.0005  # metres along each axis: the play of a tripod's screw
CAMERA_ORIENTATION = 0.05  # degrees about each axis: less than half a pixel of a 128 px image
LIGHT = 0.01  # share of the intensity: a lamp that warms up, a mains voltage that varies
PIXEL_NOISE = 1.0  # standard deviation in grey levels: one step of an 8-bit image, as another renderer makes
JOINTS = 0.2  # degrees, each joint of the arm: its repeatability with gears and calibration


def jittered(scene: Scene, number: int) -> Scene:
    """The n-th scene around a scene: the same one for the same scene and number, on any machine."""
    rng = np.random.default_rng([int(scene.digest, 16), number])
    setup = rig(scene.robot)
    joints = np.array(astuple(scene.initial_pose))
    joints[: setup.arm_joints] += rng.uniform(-JOINTS, JOINTS, setup.arm_joints)
    return replace(
        scene,
        targets=tuple(_placed(rng, target) for target in scene.targets),
        confounders=tuple(_placed(rng, confounder) for confounder in scene.confounders),
        light=Light(scene.light.intensity * (1 + float(rng.uniform(-LIGHT, LIGHT)))),
        camera=_moved(rng, scene.camera),
        noise=replace(scene.noise, grain=math.hypot(scene.noise.grain, PIXEL_NOISE)),
        initial_pose=InitialPose(**{f"j{index}": value for index, value in enumerate(joints.tolist(), 1)}),
    )


def _placed(rng: np.random.Generator, placement: Placement) -> Placement:
    x, y = rng.uniform(-POSITION, POSITION, 2).tolist()
    turn = float(rng.uniform(-YAW, YAW))
    moved = replace(placement, x=placement.x + x, y=placement.y + y)
    if placement.quaternion is None:
        return replace(moved, yaw=placement.yaw + turn)
    upright = Rotation.from_euler("z", turn, degrees=True)
    turned = upright * Rotation.from_quat(placement.quaternion, scalar_first=True)
    w, i, j, k = turned.as_quat(scalar_first=True).tolist()
    return replace(moved, quaternion=(w, i, j, k))


def _moved(rng: np.random.Generator, camera: Camera) -> Camera:
    x, y, z = (np.array(camera.offset) + rng.uniform(-CAMERA_POSITION, CAMERA_POSITION, 3)).tolist()
    roll, pitch, yaw = rng.uniform(-CAMERA_ORIENTATION, CAMERA_ORIENTATION, 3).tolist()
    return Camera(*polar(x, y, z), roll=camera.roll + roll, pitch=camera.pitch + pitch, yaw=camera.yaw + yaw)


def polar(x: float, y: float, z: float) -> tuple[float, float, float]:
    """A camera's distance, azimuth and elevation by its offset; metres and degrees."""
    return math.hypot(x, y, z), math.degrees(math.atan2(y, x)), math.degrees(math.atan2(z, math.hypot(x, y)))
