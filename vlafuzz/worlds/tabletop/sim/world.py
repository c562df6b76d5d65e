"""World: robot, table and objects in PhysX, one scene after the other. Equal scenes have equal trajectories.

CPU PhysX is bitwise repeatable only in a fresh PhysX scene. Rebuilding everything takes 185 ms in ManiSkill; here robot
and table move into a new, empty PhysX scene (0.2 ms) and only the objects are rebuilt. Moving the objects too, or
emptying the old scene, changes trajectories. Here are also objects as SAPIEN has them, their contacts, and settling.
"""

import hashlib
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import astuple
from functools import lru_cache
from typing import Any, TypeAlias

import numpy as np
import sapien
from sapien import physx
from scipy.spatial.transform import Rotation

from vlafuzz.common.arrays import Array
from vlafuzz.model import InitialPose, Placement, Rejection, Scene
from vlafuzz.worlds.manipulation.rigs import PANDA, Rig, rig
from vlafuzz.worlds.manipulation.rotations import rotation_matrix
from vlafuzz.worlds.tabletop.fairness.checks import SECONDS, unsettled
from vlafuzz.worlds.tabletop.fairness.footprint import pose_of
from vlafuzz.worlds.tabletop.objects.catalogue import Catalogue, models_of
from vlafuzz.worlds.tabletop.objects.model import ObjectModel
from vlafuzz.worlds.tabletop.room import DAMPING, GRASP_COSINE, GRASP_FORCE, ROLLING_DAMPING
from vlafuzz.worlds.tabletop.sim.rendering import add_entity, add_table, render_system, use_shaders
from vlafuzz.worlds.tabletop.sim.robots import MetricArm
from vlafuzz.worlds.tabletop.tasks import ARM, HAND, TABLE, State

SIM_HZ = PANDA.physics_hz  # with 15 solver iterations; at 50 Hz grasps begin to fail
_HAND = ("hand", "finger", "gripper")  # parts of the names of the hand's links


class World:
    """A robot at a table with the objects of one scene at a time."""

    def __init__(self, scene: sapien.Scene, agent: Any, rig: Rig, control_hz: int) -> None:
        """``agent``: ManiSkill's, see ``MetricPanda``."""
        self.scene, self._rig = scene, rig
        self._robot: physx.PhysxArticulation = agent.robot._objs[0]
        self.controller: MetricArm = agent.arm
        self.grip = self.controller.grip
        links: dict[str, Link] = {name: link._objs[0] for name, link in agent.robot.links_map.items()}
        self._tcp, self._tool = links[agent.tcp_name], agent.tool
        self._fingers = [[links[name] for name in finger] for finger in agent.fingers]
        self._pads = {link: finger[0] for finger in self._fingers for link in finger}
        self._substeps, self._hz = substeps(rig, control_hz)
        joints = list(agent.robot.active_joints_map)
        by_name = dict(zip(rig.joints or joints, rig.rest, strict=True))
        self._start = np.array([by_name[name] for name in joints], dtype=np.float32)
        self._arm = [joints.index(name) for name in list(by_name)[: rig.arm_joints]]
        self._bodies: list[physx.PhysxRigidDynamicComponent] = []
        self._fresh = True
        self._touched = False
        self._before: tuple[Array, Array] | None = None

    def begin(
        self, models: Sequence[ObjectModel], placements: Sequence[Placement], initial: InitialPose | None = None
    ) -> State:
        """Place the objects at rest and reset the robot, by default as the rig does; the state at the start."""
        if not self._fresh:
            self._move_over()
        self._fresh = False
        self._bodies = []
        for index, pair in enumerate(zip(models, placements, strict=True)):  # building one may raise: keep the others
            self._bodies.append(add_object(self.scene, *pair, f"{index}-{pair[1].object}"))
        self._reset_robot(initial or InitialPose())
        self._labels: dict[object, int | str] = {body: index for index, body in enumerate(self._bodies)}
        self._labels |= dict.fromkeys(self.scene.physx_system.rigid_static_components, TABLE)
        for link in self._robot.links:
            self._labels[link] = HAND if any(part in link.name for part in _HAND) else ARM
        self._placed = tuple(self._bodies)
        self.grip(1.0)
        self._touched = False
        self._before = None
        self.states_hash = hashlib.blake2b(digest_size=16)
        return self.read()

    def step(self, action: Array, relative_to: str = "target", slides: Mapping[int, Array] | None = None) -> State:
        """Execute a metric action for one control step (see ``MetricArm``); the state after it.

        ``slides``: by object, ``(2,)`` metres by which it is slid over the table meanwhile.
        """
        self.controller.command(action, relative_to)
        self._touched = self._touched or action[6] < 0
        system = self.scene.physx_system
        for _ in range(self._substeps):
            self.controller.advance(1 / self._hz)
            for index, shift in (slides or {}).items():
                self._slide(self._placed[index], shift / self._substeps)
            system.step()
        return self.read()

    @staticmethod
    def place(model: ObjectModel, placement: Placement) -> sapien.Pose:
        """The pose of an object's origin at resting height."""
        if placement.quaternion is not None:
            turn, position = pose_of(placement, model)
            return sapien.Pose(position, Rotation.from_matrix(turn).as_quat(scalar_first=True))
        pose = model.stable_pose(placement.rest)
        half = np.radians(placement.yaw) / 2
        turned = sapien.Pose(q=[np.cos(half), 0, 0, np.sin(half)]) * sapien.Pose(q=pose.quaternion)
        return sapien.Pose(np.array([placement.x, placement.y, pose.height]), turned.q)

    def put(self, number: int, pose: sapien.Pose, up: float = 0.0, *, floats: bool = False) -> None:
        """Turn an object, where it is, as in a pose on the table, or metres above.

        ``floats``: whether it stays in the air.
        """
        body = self._placed[number]
        body.entity_pose = sapien.Pose([*body.entity_pose.p[:2], pose.p[2] + up], pose.q)
        body.linear_velocity = body.angular_velocity = np.zeros(3, dtype=np.float32)
        body.disable_gravity = floats

    def exchange(self, number: int) -> State:
        """Exchange the first object with another one in all states from now on; the present state."""
        self._bodies[0], self._bodies[number] = self._bodies[number], self._bodies[0]
        self._labels |= {body: index for index, body in enumerate(self._bodies)}
        return self.read()

    @staticmethod
    def _slide(body: physx.PhysxRigidDynamicComponent, shift: Array) -> None:
        """Move a body over the table; it keeps its height and does not begin to roll."""
        pose = body.entity_pose
        body.entity_pose = sapien.Pose(pose.p + np.append(shift, 0.0), pose.q)
        body.linear_velocity = np.array([0.0, 0.0, body.linear_velocity[2]], dtype=np.float32)
        body.angular_velocity = np.zeros(3, dtype=np.float32)

    def read(self) -> State:
        """The present state, which is added to the hash."""
        poses = self.poses
        places, quaternions = [pose.p for pose in poses], [pose.q for pose in poses]
        velocities = [v for body in self._bodies for v in (body.linear_velocity, body.angular_velocity)]
        qpos, qvel = self._robot.qpos, self._robot.qvel
        exact = (*places, *quaternions, *velocities, qpos, qvel)
        self.states_hash.update(b"".join(array.tobytes() for array in exact))
        tcp = self._tcp.entity_pose
        if self._tool is not None:
            tcp = tcp * self._tool
        contacts, held = self._contacts() if self._touched else (frozenset(), None)
        positions = np.array(places, dtype=np.float64).reshape(-1, 3)
        turns = [rotation_matrix(quaternion.tolist()) for quaternion in quaternions]
        rotations = np.array(turns).reshape(-1, 3, 3)
        earlier, self._before = self._before, (positions, rotations)
        return State(
            positions=positions,
            rotations=rotations,
            tcp=tcp.p.astype(np.float64),
            tcp_rotation=tcp.to_transformation_matrix()[:3, :3].astype(np.float64),
            opening=self.controller.gripper.width(qpos),
            held=held,
            contacts=contacts,
            earlier=earlier,
            seconds=self._substeps / self._hz,
        )

    @property
    def poses(self) -> tuple[sapien.Pose, ...]:
        return tuple(body.entity_pose for body in self._bodies)

    def _move_over(self) -> None:
        """Move everything but the objects into a new PhysX scene, in the same order."""
        old, objects = self.scene, {body.entity for body in self._bodies}
        renderer = render_system(old)
        new = sapien.Scene([physx.PhysxCpuSystem(), *([renderer] if renderer else [])])
        new.physx_system.timestep = old.physx_system.timestep
        if renderer:
            use_shaders()  # cameras use the shaders that are set when they are added
        stay = [entity for entity in old.entities if entity not in objects]
        for entity in old.entities:
            old.remove_entity(entity)
        for entity in stay:
            new.add_entity(entity)
        self.scene = new

    def _reset_robot(self, initial: InitialPose) -> None:
        robot, start = self._robot, self._start.copy()
        start[self._arm] += np.radians(astuple(initial)[: len(self._arm)])
        robot.root_pose = sapien.Pose(self._rig.base)
        robot.qpos = start
        robot.qvel = np.zeros(robot.dof, dtype=np.float32)
        robot.qf = np.zeros(robot.dof, dtype=np.float32)
        self.controller.reset()
        offsets = np.degrees(robot.qpos - self._start)[self._arm].tolist()
        self.initial_pose = InitialPose(**{f"j{joint}": offset for joint, offset in enumerate(offsets, 1)})

    def _contacts(self) -> tuple[frozenset[tuple[int, int | str]], int | None]:
        """Contacts of the last physics step, see ``object_contacts``, and the object that all fingers press on."""
        pairs: set[tuple[int, int | str]] = set()
        pressed: dict[Link, dict[int, Impulses]] = {finger[0]: {} for finger in self._fingers}
        for index, other, body, impulses in object_contacts(self.scene.physx_system, self._labels):
            pairs.add((index, other))
            if body in self._pads:
                pressed[self._pads[body]].setdefault(index, []).extend(impulses)
        common = sorted(set.intersection(*map(set, pressed.values())))
        held = (index for index in common if all(_presses(one, pressed[one][index], self._hz) for one in pressed))
        return frozenset(pairs), next(held, None)


def substeps(rig: Rig, control_hz: int) -> tuple[int, int]:
    """Physics steps per control step and per second: the integers nearest to the rig's rate."""
    count = round(rig.physics_hz / control_hz)
    return count, count * control_hz


def settled(scene: Scene, catalogue: Catalogue) -> Rejection | None:
    """Why objects do not stay in place for a second, or the task is solved at once; None for a fair scene."""
    placements, models = scene.placements, models_of(scene.placements, catalogue)
    room = sapien.Scene([physx.PhysxCpuSystem()])
    room.physx_system.timestep = 1 / SIM_HZ
    add_table(room, rig(scene.robot).table)
    pairs = zip(models, placements, strict=True)
    bodies = [add_object(room, model, placement, placement.object) for model, placement in pairs]
    before = _state(room, bodies)
    for _ in range(round(SECONDS * SIM_HZ)):
        room.physx_system.step()
    after = _state(room, bodies)
    return unsettled(scene, models, before, after)


def _state(scene: sapien.Scene, bodies: Sequence[physx.PhysxRigidDynamicComponent]) -> State:
    labels: dict[object, int | str] = {body: index for index, body in enumerate(bodies)}
    labels.update(dict.fromkeys(scene.physx_system.rigid_static_components, TABLE))
    contacts = {(index, other) for index, other, *_ in object_contacts(scene.physx_system, labels)}
    matrices = [body.entity_pose.to_transformation_matrix() for body in bodies]
    return State(
        positions=np.array([matrix[:3, 3] for matrix in matrices], dtype=np.float64),
        rotations=np.array([matrix[:3, :3] for matrix in matrices], dtype=np.float64),
        tcp=np.zeros(3),
        tcp_rotation=np.eye(3),
        opening=0.0,
        contacts=frozenset(contacts),
    )


CONTACT_OFFSET = 0.005  # metres; ManiSkill's 0.02 is an eighth slower and changes no grasp


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
    components: list[sapien.Component] = [body]
    if render_system(scene) is not None:
        visual = sapien.render.RenderBodyComponent()
        visual.attach(looks(model, placement.scale))
        components.append(visual)
    add_entity(scene, name, World.place(model, placement), *components)
    return body


Labels = Mapping[object, int | str]
Link: TypeAlias = physx.PhysxArticulationLinkComponent
Impulses = list[list[float]]  # three numbers per contact point; lists are faster than arrays at this size
TOUCH_IMPULSE = 1e-6  # newton seconds; smaller for bodies that are within the contact offset but apart


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


def _presses(finger: Link, impulses: Impulses, hz: int) -> bool:
    """Whether a finger presses on an object, given the impulses of a physics step of 1 / ``hz`` seconds."""
    push = [sum(axis) for axis in zip(*impulses, strict=True)]
    size = math.hypot(*push)
    closing = finger.entity_pose.to_transformation_matrix()[:3, 1].tolist()
    along = sum(a * b for a, b in zip(closing, push, strict=True))
    return size * hz >= GRASP_FORCE and abs(along) >= GRASP_COSINE * size
