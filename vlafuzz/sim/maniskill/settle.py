"""Settling: one second of physics without a robot, in which the objects of a fair scene stay in place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import sapien
from sapien import physx

from vlafuzz.objects.model import ObjectModel
from vlafuzz.rigs.rig import Table
from vlafuzz.rigs.robots import PANDA
from vlafuzz.scene import Placement
from vlafuzz.sim.maniskill.contacts import object_contacts
from vlafuzz.sim.maniskill.objects import add_object, place
from vlafuzz.sim.maniskill.table import add_table
from vlafuzz.sim.maniskill.world import SIM_HZ
from vlafuzz.tasks.base import TABLE, Situation, State, Task
from vlafuzz.validity import Rejection

SECONDS = 1.0
MOVED = 0.01  # metres
TIPPED = np.cos(np.radians(15.0))
FALLEN = -0.1  # metres


@dataclass(frozen=True)
class Settled:
    """The state of a scene before the policy acts.

    Attributes:
        shift: largest horizontal distance of an object from where the scene places it, metres.
        solved: whether the task is solved already; ``published``: by the published criteria.
    """

    shift: float
    solved: bool
    published: bool
    rejection: Rejection | None


def settle(
    task: Task,
    models: Sequence[ObjectModel],
    placements: Sequence[Placement],
    table: Table = PANDA.table,
    dropped: Sequence[sapien.Pose] | None = None,
) -> Settled:
    """Check that the objects stay in place and that the task is not solved before the policy acts.

    No object may move by more than 1 cm or tip by more than 15 degrees within a second; success must hold
    neither before nor after.

    Args:
        dropped: poses of the objects if they were dropped. Then they only have to stay on the table.
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
    spots = np.array([pose.p[:2] for pose in wanted])
    return Settled(
        shift=float(np.linalg.norm(((before if dropped else after).positions[:, :2] - spots), axis=1).max()),
        solved=bool(solved),
        published=task.published(Situation(tuple(models), before, before)),
        rejection=_restless(placements, before, after, dropped=dropped is not None)
        or _solved(task.name, solved),
    )


def _restless(
    placements: Sequence[Placement], before: State, after: State, *, dropped: bool
) -> Rejection | None:
    for index, placement in enumerate(placements):
        reason = _fell(after, index) or (None if dropped else _moved(before, after, index))
        if reason:
            return Rejection(
                "settling", f"{placement.object} at ({placement.x:.3f}, {placement.y:.3f}) {reason}"
            )
    return None


def _solved(task: str, moments: Sequence[str]) -> Rejection | None:
    return Rejection("solved", f"{task} is solved {moments[0]}, before the policy acts") if moments else None


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


def _fell(after: State, index: int) -> str | None:
    end = after.positions[index]
    if not np.all(np.isfinite(end)):
        return "has no finite position after settling"
    return f"fell to z = {end[2]:.2f} m" if end[2] < FALLEN else None


def _moved(before: State, after: State, index: int) -> str | None:
    distance = float(np.linalg.norm(after.positions[index] - before.positions[index]))
    if distance > MOVED:
        return f"moved {distance * 100:.1f} cm while settling, more than {MOVED * 100:.0f} cm"
    vertical = float(before.rotations[index][2] @ after.rotations[index][2])
    if vertical < TIPPED:
        return f"tipped by {np.degrees(np.arccos(np.clip(vertical, -1, 1))):.0f} degrees while settling"
    return None
