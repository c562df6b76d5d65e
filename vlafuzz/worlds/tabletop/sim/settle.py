"""Where a scene's objects come to rest, without a robot.

``settle`` simulates one second, in which the objects of a fair scene stay in place. In the published placement, they
are dropped from half a metre, cannot tip at first, and stay where they come to rest: in pick-up first the target and
then the others, one by one and straight down; in the other tasks all at once. Source: VLATest's ``_initialize_actors``
of ``{grasp_single,move_near}_in_scene_customizable.py``.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import sapien
from sapien import physx

from vlafuzz.model.outcome import Rejection
from vlafuzz.model.scene import Placement, Scene
from vlafuzz.worlds.manipulation.rigs import PANDA, Rig, Table
from vlafuzz.worlds.tabletop.objects.model import ObjectModel
from vlafuzz.worlds.tabletop.sim.objects import add_object, object_contacts, place
from vlafuzz.worlds.tabletop.sim.table import add_table
from vlafuzz.worlds.tabletop.sim.world import SIM_HZ
from vlafuzz.worlds.tabletop.state import TABLE, Situation, State, TableTask

SECONDS = 1.0
MOVED = 0.01  # metres
TIPPED = np.cos(np.radians(15.0))
FALLEN = -0.1  # metres
HEIGHT = 0.5  # of the mesh's origin over the table, metres
DAMPING = 0.1
SLEEP_THRESHOLD = 5e-3  # SAPIEN's default: bodies that lie still fall asleep
ITERATIONS = 25
LOCKED, FREE, EXTRA = 0.5, 0.5, 1.5  # seconds with locked axes, after that, and more if objects still move
SPEED, TURN_RATE = 1e-3, 1e-2  # summed metres and radians per second above which objects still move
UPRIGHT, STRAIGHT = (3, 4), (0, 1, 3, 4)  # locked axes: no tipping; no motion but down

Body: TypeAlias = physx.PhysxRigidDynamicComponent


@dataclass(frozen=True)
class Settled:
    """The state of a scene before the policy acts."""

    shift: float  # largest horizontal distance of an object from where the scene places it, metres
    solved: bool  # whether the task is solved already
    published: bool  # the same by the published criteria
    rejection: Rejection | None


def settle(
    task: TableTask,
    models: Sequence[ObjectModel],
    placements: Sequence[Placement],
    table: Table = PANDA.table,
    dropped: Sequence[sapien.Pose] | None = None,
) -> Settled:
    """Check that the objects stay in place and that the task is not solved before the policy acts.

    No object may move by more than 1 cm or tip by more than 15 degrees within a second; success must hold neither
    before nor after. Objects that were dropped, to poses ``dropped``, only have to stay on the table.
    """
    scene = sapien.Scene([physx.PhysxCpuSystem()])
    scene.physx_system.timestep = 1 / SIM_HZ
    add_table(scene, table)
    wanted = [place(*pair) for pair in zip(models, placements, strict=True)]
    bodies = [
        add_object(scene, model, placement, placement.object, pose)
        for model, placement, pose in zip(models, placements, dropped or wanted, strict=True)
    ]
    before = _state(scene, bodies)
    for _ in range(round(SECONDS * SIM_HZ)):
        scene.physx_system.step()
    after = _state(scene, bodies)
    moments = (("at the start", before), ("after settling", after))
    solved = [moment for moment, state in moments if task.solved(tuple(models), state)]
    rejection = _restless(placements, before, after, dropped=dropped is not None)
    if solved and rejection is None:
        rejection = Rejection("solved", f"{task.name} is solved {solved[0]}, before the policy acts")
    spots = np.array([pose.p[:2] for pose in wanted])
    return Settled(
        shift=float(np.linalg.norm(((before if dropped else after).positions[:, :2] - spots), axis=1).max()),
        solved=bool(solved),
        published=task.published(Situation(tuple(models), before, before)),
        rejection=rejection,
    )


def _restless(placements: Sequence[Placement], before: State, after: State, *, dropped: bool) -> Rejection | None:
    for index, placement in enumerate(placements):
        end, reason = after.positions[index], ""
        distance = float(np.linalg.norm(end - before.positions[index]))
        vertical = float(before.rotations[index][2] @ after.rotations[index][2])
        if not np.all(np.isfinite(end)):
            reason = "has no finite position after settling"
        elif end[2] < FALLEN:
            reason = f"fell to z = {end[2]:.2f} m"
        elif distance > MOVED and not dropped:
            reason = f"moved {distance * 100:.1f} cm while settling, more than {MOVED * 100:.0f} cm"
        elif vertical < TIPPED and not dropped:
            tilt = np.degrees(np.arccos(np.clip(vertical, -1, 1)))
            reason = f"tipped by {tilt:.0f} degrees while settling"
        if reason:
            where = f"{placement.object} at ({placement.x:.3f}, {placement.y:.3f})"
            return Rejection("settling", f"{where} {reason}")
    return None


def _state(scene: sapien.Scene, bodies: Sequence[Body]) -> State:
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


def start_poses(scene: Scene, models: Sequence[ObjectModel], rig: Rig, *, dropped: bool) -> list[sapien.Pose]:
    """Start poses of a scene's objects: at rest where the scene places them, or where they have fallen."""
    things = list(zip(models, scene.placements, strict=True))
    if not dropped:
        return [place(*thing) for thing in things]
    drop = _Drop(rig)
    if scene.task != "pick-up":
        return [body.entity_pose for body in drop.together(things)]
    first, others = drop.together(things[:1]), []
    for thing in things[1:]:
        others.append(drop.hang(*thing))
        _lock(others[-1:], STRAIGHT)
        drop.run(LOCKED)
    for body in others:
        _let_go([body])
        drop.run(FREE)
    drop.wait_for(others)
    return [body.entity_pose for body in first + others]


class _Drop:
    """A table onto which objects are dropped."""

    def __init__(self, rig: Rig) -> None:
        self._hz = rig.physics_hz
        self._scene = sapien.Scene([_system()])
        self._scene.physx_system.timestep = 1 / self._hz
        add_table(self._scene, rig.table)

    def together(self, things: Sequence[tuple[ObjectModel, Placement]]) -> list[Body]:
        """Drop objects together; their bodies once they have come to rest."""
        bodies = [self.hang(*thing) for thing in things]
        _lock(bodies, UPRIGHT)
        self.run(LOCKED)
        _let_go(bodies)
        self.run(FREE)
        self.wait_for(bodies)
        return bodies

    def hang(self, model: ObjectModel, placement: Placement) -> Body:
        body = add_object(self._scene, model, placement, placement.object)
        body.linear_damping = body.angular_damping = DAMPING
        body.sleep_threshold, body.solver_position_iterations = SLEEP_THRESHOLD, ITERATIONS
        over, turned = place(model, placement), placement.quaternion
        above = float(model.shift(turned)[2]) * placement.scale if turned else 0.0
        body.entity.pose = sapien.Pose([*over.p[:2], HEIGHT + above], over.q)
        return body

    def wait_for(self, bodies: Sequence[Body]) -> None:
        speed = sum(float(np.linalg.norm(body.linear_velocity)) for body in bodies)
        turning = sum(float(np.linalg.norm(body.angular_velocity)) for body in bodies)
        if speed > SPEED or turning > TURN_RATE:
            self.run(EXTRA)

    def run(self, seconds: float) -> None:
        for _ in range(int(seconds * self._hz)):
            self._scene.physx_system.step()


def _system() -> physx.PhysxCpuSystem:
    """Without persistent contact manifolds, as in VLATest; with them, a can on its side keeps rolling."""
    usual, config = physx.get_scene_config(), physx.get_scene_config()
    config.enable_pcm = False
    physx.set_scene_config(config)
    try:
        return physx.PhysxCpuSystem()
    finally:
        physx.set_scene_config(usual)


def _lock(bodies: Sequence[Body], axes: Sequence[int]) -> None:
    for body in bodies:
        body.set_locked_motion_axes([axis in axes for axis in range(6)])


def _let_go(bodies: Sequence[Body]) -> None:
    _lock(bodies, ())
    for body in bodies:
        body.linear_velocity = body.angular_velocity = np.zeros(3)
        body.wake_up()
