"""Table and floor."""

from __future__ import annotations

import sapien
from sapien import physx

from vlafuzz.sim.maniskill.rendering import render_system

HALF = (0.6, 0.7, 0.03)  # metres; the top is z = 0, the robot stands on it
CENTRE = (-0.25, 0.0, -0.03)
COLOUR = (0.52, 0.44, 0.36)
FLOOR_COLOUR = (0.30, 0.31, 0.33)
FLOOR = -0.75
FRICTION = 0.6


def add_table(scene: sapien.Scene) -> sapien.Entity:
    """A static box, visible where the scene can render, then on a floor."""
    body = physx.PhysxRigidStaticComponent()
    body.attach(physx.PhysxCollisionShapeBox(list(HALF), physx.PhysxMaterial(FRICTION, FRICTION, 0.0)))
    table = sapien.Entity()
    table.name = "table"
    table.add_component(body)
    if render_system(scene) is not None:
        table.add_component(_box(HALF, COLOUR))
        floor = sapien.Entity()
        floor.name = "floor"
        floor.add_component(_box((3.0, 3.0, 0.01), FLOOR_COLOUR))
        floor.pose = sapien.Pose([0, 0, FLOOR])
        scene.add_entity(floor)
    table.pose = sapien.Pose(CENTRE)
    scene.add_entity(table)
    return table


def _box(
    half: tuple[float, float, float], colour: tuple[float, float, float]
) -> sapien.render.RenderBodyComponent:
    material = sapien.render.RenderMaterial(base_color=[*colour, 1.0], roughness=0.8, specular=0.1)
    visual = sapien.render.RenderBodyComponent()
    visual.attach(sapien.render.RenderShapeBox(list(half), material))
    return visual
