"""Catalogue objects as SAPIEN entities."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
import sapien
from numpy.typing import NDArray
from sapien import physx
from scipy.spatial.transform import Rotation

from vlafuzz.objects.catalogue import Catalogue
from vlafuzz.objects.model import ObjectModel
from vlafuzz.scene import Placement
from vlafuzz.sim.maniskill.rendering import render_system

CONTACT_OFFSET = 0.005  # metres; ManiSkill's 0.02 is an eighth slower and changes no grasp
# PhysX has no rolling friction, and a polygonal can even accelerates: pushed at 0.1 m/s it rolls forever with
# a damping of 0.5 1/s, sometimes with 2, and stops within 5 cm with 5.
DAMPING, ROLLING_DAMPING = 0.5, 5.0


def resting_pose(model: ObjectModel, placement: Placement) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The pose of an object's origin for a placement, at resting height.

    Returns:
        position ``(3,)`` in metres, quaternion ``(4,)`` wxyz.
    """
    if placement.quaternion is not None:
        turn = model.turned(placement.quaternion)
        x, y, _ = model.shift(placement.quaternion) * placement.scale
        height = -float((model.vertices @ turn[2]).min())
        return np.array([placement.x + x, placement.y + y, height]), as_quaternion(turn)
    pose = model.stable_pose(placement.rest)
    half = np.radians(placement.yaw) / 2
    turned = sapien.Pose(q=[np.cos(half), 0, 0, np.sin(half)]) * sapien.Pose(q=pose.quaternion)
    return np.array([placement.x, placement.y, pose.height]), np.array(turned.q, dtype=np.float64)


def as_quaternion(turn: NDArray[np.float64]) -> NDArray[np.float64]:
    """The quaternion ``(4,)`` wxyz of a rotation matrix."""
    return np.asarray(Rotation.from_matrix(turn).as_quat(scalar_first=True))


def models_of(placements: Sequence[Placement], catalogue: Catalogue) -> tuple[ObjectModel, ...]:
    """The models of a scene's objects, scaled to their sizes."""
    return tuple(catalogue[placement.object].scaled(placement.scale) for placement in placements)


def place(model: ObjectModel, placement: Placement) -> sapien.Pose:
    """``resting_pose`` as a SAPIEN pose."""
    position, quaternion = resting_pose(model, placement)
    return sapien.Pose(position, quaternion)


@lru_cache(maxsize=64)
def _material(friction: float) -> physx.PhysxMaterial:
    return physx.PhysxMaterial(friction, friction, 0.0)


def looks(model: ObjectModel, scale: float = 1.0) -> sapien.render.RenderShapeTriangleMesh:
    """The visual mesh of an object in its own frame."""
    fit = model.fit
    size = scale * fit.scale if fit else scale
    shape = sapien.render.RenderShapeTriangleMesh(str(model.visual), [size] * 3)
    if fit:
        shape.local_pose = sapien.Pose(fit.position * scale, fit.quaternion)
    return shape


def add_object(
    scene: sapien.Scene, model: ObjectModel, placement: Placement, name: str, pose: sapien.Pose | None = None
) -> physx.PhysxRigidDynamicComponent:
    """Build an object and add it, by default at its resting pose; with visuals if the scene can render."""
    body = physx.PhysxRigidDynamicComponent()
    scale = [placement.scale] * 3
    for file in model.collision:
        shape = physx.PhysxCollisionShapeConvexMesh(str(file), scale, _material(model.friction))
        shape.density = model.density
        shape.contact_offset = CONTACT_OFFSET
        body.attach(shape)
    body.angular_damping = ROLLING_DAMPING if any(pose.rolls for pose in model.stable_poses) else DAMPING
    body.sleep_threshold = 0.0  # a sleeping body reports no contacts
    entity = sapien.Entity()
    entity.name = name
    entity.add_component(body)
    if render_system(scene) is not None:
        visual = sapien.render.RenderBodyComponent()
        visual.attach(looks(model, placement.scale))
        entity.add_component(visual)
    entity.pose = pose or place(model, placement)
    scene.add_entity(entity)
    return body
