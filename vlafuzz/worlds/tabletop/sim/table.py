"""Table, floor and wall, the background of every picture, in the colours and patterns of a backdrop."""

from collections.abc import Sequence

import numpy as np
import sapien
from numpy.typing import NDArray
from sapien import physx

from vlafuzz.model.scene import Backdrop
from vlafuzz.worlds.manipulation.rigs.backdrops import (
    COLOUR,
    FLOOR_COLOUR,
    PAINTS,
    WALL,
    WALL_COLOUR,
    Colour,
    planks,
    shade,
)
from vlafuzz.worlds.manipulation.rigs.rig import Table
from vlafuzz.worlds.tabletop.sim.rendering import render_system

FRICTION = 0.6


def add_table(scene: sapien.Scene, size: Table) -> sapien.Entity:
    """Add a static box; if the scene can render, a visible one with floor and wall."""
    body = physx.PhysxRigidStaticComponent()
    body.attach(physx.PhysxCollisionShapeBox(list(size.half), physx.PhysxMaterial(FRICTION, FRICTION, 0.0)))
    table = sapien.Entity()
    table.name = "table"
    table.add_component(body)
    table.pose = sapien.Pose([*size.centre, -size.half[2]])
    rendered = render_system(scene) is not None
    if rendered:
        table.add_component(_box(size.half, _painted(shaded(COLOUR, planks()))))
    scene.add_entity(table)
    if rendered:  # after the table: what it hides need not be shaded
        wall = sapien.render.RenderMaterial(base_color=[*WALL_COLOUR, 1.0], roughness=0.9, specular=0.0)
        scene.add_entity(_standing("wall", (0.01, 3.0, 2.0), wall, (WALL, 0.0, size.floor + 2.0)))
        scene.add_entity(_standing("floor", (3.0, 3.0, 0.01), _painted(_tiles()), (0.0, 0.0, size.floor)))
    return table


def _standing(
    name: str,
    half: tuple[float, float, float],
    material: sapien.render.RenderMaterial,
    position: tuple[float, float, float],
) -> sapien.Entity:
    entity = sapien.Entity()
    entity.name = name
    entity.add_component(_box(half, material))
    entity.pose = sapien.Pose(position)
    return entity


def _box(
    half: tuple[float, float, float], material: sapien.render.RenderMaterial
) -> sapien.render.RenderBodyComponent:
    visual = sapien.render.RenderBodyComponent()
    visual.attach(sapien.render.RenderShapeBox(list(half), material))
    return visual


def _painted(picture: NDArray[np.uint8]) -> sapien.render.RenderMaterial:
    """A material with an sRGB texture ``(height, width, 3)``."""
    material = sapien.render.RenderMaterial(base_color=[1.0, 1.0, 1.0, 1.0], roughness=0.8, specular=0.1)
    material.base_color_texture = texture(picture)
    return material


def texture(picture: NDArray[np.uint8]) -> sapien.render.RenderTexture2D:
    """A texture from an sRGB image ``(height, width, 3)``."""
    linear = (picture / 255.0) ** 2.2
    opaque = np.concatenate([linear, np.ones((*linear.shape[:2], 1))], axis=2)
    return sapien.render.RenderTexture2D(
        np.round(opaque * 255).astype(np.uint8), "R8G8B8A8Unorm", mipmap_levels=6
    )


def shaded(colour: Sequence[float], shade: NDArray[np.float64]) -> NDArray[np.uint8]:
    """An sRGB image in shades of a colour that is its mean (linear, like all colours of the catalogue)."""
    return _bytes(np.array(colour) * (shade / shade.mean())[..., None])


def _tiles(size: int = 128) -> NDArray[np.uint8]:
    rng = np.random.default_rng(5)
    cells = size // 8
    shade = 1.0 + rng.normal(0, 0.04, (8, 8)).repeat(cells, axis=0).repeat(cells, axis=1)
    joint = np.arange(size) % cells < 1
    shade[joint], shade[:, joint] = 0.75, 0.75
    return _bytes(np.array(FLOOR_COLOUR) * shade[..., None])


def _bytes(linear: NDArray[np.float64]) -> NDArray[np.uint8]:
    return np.round(np.clip(linear, 0, 1) ** (1 / 2.2) * 255).astype(np.uint8)


class BackdropPainter:
    """Paints one table and its wall, which are nominal at first. Without a renderer it paints nothing."""

    def __init__(self, scene: sapien.Scene) -> None:
        self.backdrop = Backdrop()
        if render_system(scene) is None:
            self._materials = None
            return
        entities = {entity.name: entity for entity in scene.entities}
        self._materials = _material(entities["table"]), _material(entities["wall"])
        self._textures = {("planks", "oak"): self._materials[0].base_color_texture}

    def paint(self, backdrop: Backdrop) -> Colour:
        """Show a backdrop; the mean colour of the table top."""
        if self._materials is not None and backdrop != self.backdrop:
            table, wall = self._materials
            look = backdrop.table, backdrop.colour
            if look not in self._textures:
                self._textures[look] = texture(shaded(PAINTS[backdrop.colour], shade(backdrop.table)))
            table.base_color_texture = self._textures[look]
            wall.base_color = [*PAINTS[backdrop.wall], 1.0]
        self.backdrop = backdrop
        return PAINTS[backdrop.colour]


def _material(entity: sapien.Entity) -> sapien.render.RenderMaterial:
    body = entity.find_component_by_type(sapien.render.RenderBodyComponent)
    return body.render_shapes[0].material
