"""Catalogue objects as SAPIEN entities, and their contacts read from PhysX."""

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from typing import TypeAlias

import numpy as np
import sapien
from sapien import physx
from scipy.spatial.transform import Rotation

from vlafuzz.model.scene import Placement
from vlafuzz.worlds.tabletop.objects.catalogue import Catalogue
from vlafuzz.worlds.tabletop.objects.model import ObjectModel
from vlafuzz.worlds.tabletop.sim.rendering import render_system
from vlafuzz.worlds.tabletop.tasks import HAND

CONTACT_OFFSET = 0.005  # metres; ManiSkill's 0.02 is an eighth slower and changes no grasp
# PhysX has no rolling friction, and a polygonal can even accelerates: pushed at 0.1 m/s it rolls forever with
# a damping of 0.5 1/s, sometimes with 2, and stops within 5 cm with 5.
DAMPING, ROLLING_DAMPING = 0.5, 5.0


def place(model: ObjectModel, placement: Placement) -> sapien.Pose:
    """The pose of an object's origin at resting height."""
    if placement.quaternion is not None:
        turn = model.turned(placement.quaternion)
        x, y, _ = model.shift(placement.quaternion) * placement.scale
        height = -float((model.vertices @ turn[2]).min())
        quaternion = np.asarray(Rotation.from_matrix(turn).as_quat(scalar_first=True))
        return sapien.Pose(np.array([placement.x + x, placement.y + y, height]), quaternion)
    pose = model.stable_pose(placement.rest)
    half = np.radians(placement.yaw) / 2
    turned = sapien.Pose(q=[np.cos(half), 0, 0, np.sin(half)]) * sapien.Pose(q=pose.quaternion)
    return sapien.Pose(np.array([placement.x, placement.y, pose.height]), turned.q)


def models_of(placements: Sequence[Placement], catalogue: Catalogue) -> tuple[ObjectModel, ...]:
    """The models of a scene's objects, scaled to their sizes."""
    return tuple(catalogue[placement.object].scaled(placement.scale) for placement in placements)


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
    scene: sapien.Scene, model: ObjectModel, placement: Placement, name: str
) -> physx.PhysxRigidDynamicComponent:
    """Build an object and add it at its resting pose; with visuals if the scene can render."""
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
    entity.pose = place(model, placement)
    scene.add_entity(entity)
    return body


Labels = Mapping[object, int | str]
Link: TypeAlias = physx.PhysxArticulationLinkComponent
Impulses = list[list[float]]  # three numbers per contact point; lists are faster than arrays at this size
Pressed = dict[Link, dict[int, Impulses]]  # by finger and object
TOUCH_IMPULSE = 1e-6  # newton seconds; smaller for bodies that are within the contact offset but apart
GRASP_FORCE = 0.5  # newtons per finger, as in ManiSkill's is_grasping
GRASP_COSINE = math.cos(math.radians(85.0))


def object_contacts(system: physx.PhysxCpuSystem, labels: Labels) -> Iterator[tuple[int, int | str, object, Impulses]]:
    """Contacts of the first target, and of the hand with objects, in the last physics step.

    Each is an object's index, label and body of what it touches, and impulses in newton seconds; a contact of two
    objects comes in both orders. ``labels``: an object's index or another name, by body. All other contacts are
    skipped: nobody needs them, and reading them takes time.
    """
    for contact in system.get_contacts():
        first, second = contact.bodies
        label, other = labels[first], labels[second]
        if not (label == 0 or other == 0 or label == HAND or other == HAND):
            continue
        impulses = [point.impulse.tolist() for point in contact.points]
        if all(max(map(abs, impulse)) < TOUCH_IMPULSE for impulse in impulses):
            continue
        if isinstance(label, int):
            yield label, other, second, impulses
        if isinstance(other, int):
            yield other, label, first, impulses


def held_object(pressed: Pressed, hz: int) -> int | None:
    """The object that all fingers press on, given the impulses of a physics step of 1 / ``hz`` seconds."""
    for index in sorted(set.intersection(*map(set, pressed.values()))):
        if all(_presses(finger, objects[index], hz) for finger, objects in pressed.items()):
            return index
    return None


def _presses(finger: Link, impulses: Impulses, hz: int) -> bool:
    push = [sum(axis) for axis in zip(*impulses, strict=True)]
    size = math.hypot(*push)
    closing = finger.entity_pose.to_transformation_matrix()[:3, 1].tolist()
    along = sum(a * b for a, b in zip(closing, push, strict=True))
    return size * hz >= GRASP_FORCE and abs(along) >= GRASP_COSINE * size
