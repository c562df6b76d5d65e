"""Settling: whether objects stay where the scene has them, in a second of physics without a robot."""

from collections.abc import Sequence

import numpy as np
import sapien
from sapien import physx

from vlafuzz.model.outcome import Rejection
from vlafuzz.model.scene import Placement, Scene
from vlafuzz.worlds.manipulation.rigs import PANDA, Table, rig
from vlafuzz.worlds.tabletop.objects.catalogue import Catalogue
from vlafuzz.worlds.tabletop.objects.model import ObjectModel
from vlafuzz.worlds.tabletop.sim.objects import add_object, models_of, object_contacts
from vlafuzz.worlds.tabletop.sim.table import add_table
from vlafuzz.worlds.tabletop.sim.world import SIM_HZ
from vlafuzz.worlds.tabletop.state import TABLE, State, TableTask
from vlafuzz.worlds.tabletop.tasks import task as task_named

SECONDS = 1.0
MOVED = 0.01  # metres
TIPPED = np.cos(np.radians(15.0))
FALLEN = -0.1  # metres


def settled(scene: Scene, catalogue: Catalogue) -> Rejection | None:
    """``settle`` of a scene whose objects are in the catalogue."""
    models = models_of(scene.placements, catalogue)
    return settle(task_named(scene.task), models, scene.placements, rig(scene.robot).table)


def settle(
    task: TableTask, models: Sequence[ObjectModel], placements: Sequence[Placement], table: Table = PANDA.table
) -> Rejection | None:
    """Check that the objects stay in place and that the task is not solved before the policy acts.

    No object may move by more than 1 cm or tip by more than 15 degrees within a second; success must hold neither
    before nor after.
    """
    scene = sapien.Scene([physx.PhysxCpuSystem()])
    scene.physx_system.timestep = 1 / SIM_HZ
    add_table(scene, table)
    pairs = zip(models, placements, strict=True)
    bodies = [add_object(scene, model, placement, placement.object) for model, placement in pairs]
    before = _state(scene, bodies)
    for _ in range(round(SECONDS * SIM_HZ)):
        scene.physx_system.step()
    after = _state(scene, bodies)
    if rejection := _restless(placements, before, after):
        return rejection
    for moment, state in (("at the start", before), ("after settling", after)):
        if task.solved(tuple(models), state):
            return Rejection("solved", f"{task.name} is solved {moment}, before the policy acts")
    return None


def _restless(placements: Sequence[Placement], before: State, after: State) -> Rejection | None:
    for index, placement in enumerate(placements):
        end, reason = after.positions[index], ""
        distance = float(np.linalg.norm(end - before.positions[index]))
        vertical = float(before.rotations[index][2] @ after.rotations[index][2])
        if not np.all(np.isfinite(end)):
            reason = "has no finite position after settling"
        elif end[2] < FALLEN:
            reason = f"fell to z = {end[2]:.2f} m"
        elif distance > MOVED:
            reason = f"moved {distance * 100:.1f} cm while settling, more than {MOVED * 100:.0f} cm"
        elif vertical < TIPPED:
            tilt = np.degrees(np.arccos(np.clip(vertical, -1, 1)))
            reason = f"tipped by {tilt:.0f} degrees while settling"
        if reason:
            where = f"{placement.object} at ({placement.x:.3f}, {placement.y:.3f})"
            return Rejection("settling", f"{where} {reason}")
    return None


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
