"""The published placement: objects are dropped, as in VLATest, and lie where they come to rest.

They fall from half a metre over the table with a robot out of the way, and cannot tip at first. In pick-up
the target comes first and then the others, one by one and straight down; in the other tasks all at once.
Source: ``_initialize_actors`` of its ``grasp_single_in_scene_customizable.py`` and
``move_near_in_scene_customizable.py``.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
import sapien
from sapien import physx

from vlafuzz.objects.model import ObjectModel
from vlafuzz.rigs.rig import Rig
from vlafuzz.scene import Placement, Scene
from vlafuzz.sim.maniskill.objects import add_object, place
from vlafuzz.sim.maniskill.table import add_table

HEIGHT = 0.5  # metres, of the mesh's origin over the table
DAMPING = 0.1
SLEEPS = 5e-3  # SAPIEN's own threshold: what lies still falls asleep
ITERATIONS = 25
FALLS, RESTS, LONGER = 0.5, 0.5, 1.5  # seconds: until it is let go, from then on, and if it still moves
MOVES, TURNS = 1e-3, 1e-2  # metres and radians a second, summed, above which things still move
UPRIGHT, STRAIGHT = (3, 4), (0, 1, 3, 4)  # axes that are locked: no tipping; nor any way but down

Body: TypeAlias = physx.PhysxRigidDynamicComponent


class Drop:
    """A table that things fall onto."""

    def __init__(self, rig: Rig) -> None:
        self._hz = rig.physics_hz
        self._scene = sapien.Scene([_system()])
        self._scene.physx_system.timestep = 1 / self._hz
        add_table(self._scene, rig.table)

    def all_at_once(self, models: Sequence[ObjectModel], placements: Sequence[Placement]) -> list[Body]:
        """The bodies once they lie."""
        bodies = [self._hang(*each) for each in zip(models, placements, strict=True)]
        _lock(bodies, UPRIGHT)
        self._run(FALLS)
        _let_go(bodies)
        self._run(RESTS)
        self._wait_for(bodies)
        return bodies

    def one_by_one(self, models: Sequence[ObjectModel], placements: Sequence[Placement]) -> list[Body]:
        """As ``all_at_once``, but the first comes first, and no other moves aside before all are there."""
        first = self.all_at_once(models[:1], placements[:1])
        others = []
        for model, placement in zip(models[1:], placements[1:], strict=True):
            others.append(self._hang(model, placement))
            _lock(others[-1:], STRAIGHT)
            self._run(FALLS)
        for body in others:
            _let_go([body])
            self._run(RESTS)
        self._wait_for(others)
        return first + others

    def _hang(self, model: ObjectModel, placement: Placement) -> Body:
        body = add_object(self._scene, model, placement, placement.object)
        body.linear_damping = body.angular_damping = DAMPING
        body.sleep_threshold, body.solver_position_iterations = SLEEPS, ITERATIONS
        over, turned = place(model, placement), placement.quaternion
        above = float(model.shift(turned)[2]) * placement.scale if turned else 0.0
        body.entity.pose = sapien.Pose([*over.p[:2], HEIGHT + above], over.q)
        return body

    def _wait_for(self, bodies: Sequence[Body]) -> None:
        speed = sum(float(np.linalg.norm(body.linear_velocity)) for body in bodies)
        turning = sum(float(np.linalg.norm(body.angular_velocity)) for body in bodies)
        if speed > MOVES or turning > TURNS:
            self._run(LONGER)

    def _run(self, seconds: float) -> None:
        for _ in range(int(seconds * self._hz)):
            self._scene.physx_system.step()


def start_poses(scene: Scene, models: Sequence[ObjectModel], rig: Rig, *, dropped: bool) -> list[sapien.Pose]:
    """Where the objects of a scene are at its start: at rest where it puts them, or where they fell."""
    if not dropped:
        return [place(*each) for each in zip(models, scene.placements, strict=True)]
    drop = Drop(rig)
    fall = drop.one_by_one if scene.task == "pick-up" else drop.all_at_once
    return [body.entity_pose for body in fall(models, scene.placements)]


def _system() -> physx.PhysxCpuSystem:
    """Without persistent contact manifolds, as there: with them, a can on its side rolls on by itself."""
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
