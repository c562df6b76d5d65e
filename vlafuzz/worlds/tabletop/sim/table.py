"""Table, floor and wall, the background of every picture, in the colours and patterns of a backdrop."""

from collections.abc import Sequence

import numpy as np
import sapien
from numpy.typing import NDArray
from sapien import physx
from sapien.render import RenderMaterial, RenderTexture2D

from vlafuzz.model.scene import Backdrop
from vlafuzz.worlds.manipulation.looks import COLOUR, FLOOR_COLOUR, PAINTS, WALL, WALL_COLOUR, Colour, planks, shade
from vlafuzz.worlds.manipulation.rigs import Table
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
        _cover(table, size.half, _painted(_shaded(COLOUR, planks())))
    scene.add_entity(table)
    if rendered:  # after the table: what it hides need not be shaded
        plain = RenderMaterial(base_color=[*WALL_COLOUR, 1.0], roughness=0.9, specular=0.0)
        for name, half, material, place in (
            ("wall", (0.01, 3.0, 2.0), plain, (WALL, 0.0, size.floor + 2.0)),
            ("floor", (3.0, 3.0, 0.01), _painted(_tiles()), (0.0, 0.0, size.floor)),
        ):
            entity = sapien.Entity()
            entity.name = name
            _cover(entity, half, material)
            entity.pose = sapien.Pose(place)
            scene.add_entity(entity)
    return table


def _cover(entity: sapien.Entity, half: tuple[float, float, float], material: RenderMaterial) -> None:
    """Make a box visible."""
    visual = sapien.render.RenderBodyComponent()
    visual.attach(sapien.render.RenderShapeBox(list(half), material))
    entity.add_component(visual)


def _painted(texture: RenderTexture2D) -> RenderMaterial:
    material = RenderMaterial(base_color=[1.0, 1.0, 1.0, 1.0], roughness=0.8, specular=0.1)
    material.base_color_texture = texture
    return material


def _texture(colours: NDArray[np.float64]) -> RenderTexture2D:
    """A texture of linear colours ``(height, width, 3)``, rounded as in an image of sRGB."""
    srgb = np.round(np.clip(colours, 0, 1) ** (1 / 2.2) * 255).astype(np.uint8)
    linear = (srgb / 255.0) ** 2.2
    opaque = np.concatenate([linear, np.ones((*linear.shape[:2], 1))], axis=2)
    return RenderTexture2D(np.round(opaque * 255).astype(np.uint8), "R8G8B8A8Unorm", mipmap_levels=6)


def _shaded(colour: Sequence[float], shade: NDArray[np.float64]) -> RenderTexture2D:
    """Shades of a colour that is their mean, linear like all colours of the catalogue."""
    return _texture(np.array(colour) * (shade / shade.mean())[..., None])


def _tiles(size: int = 128) -> RenderTexture2D:
    cells = size // 8
    shade = 1.0 + np.random.default_rng(5).normal(0, 0.04, (8, 8)).repeat(cells, axis=0).repeat(cells, axis=1)
    joint = np.arange(size) % cells < 1
    shade[joint], shade[:, joint] = 0.75, 0.75
    return _texture(np.array(FLOOR_COLOUR) * shade[..., None])


class BackdropPainter:
    """Paints one table and its wall, which are nominal at first. Without a renderer it paints nothing."""

    def __init__(self, scene: sapien.Scene) -> None:
        self.backdrop = Backdrop()
        self._materials: list[RenderMaterial] = []
        if render_system(scene) is not None:
            entities = {entity.name: entity for entity in scene.entities}
            for name in ("table", "wall"):
                body = entities[name].find_component_by_type(sapien.render.RenderBodyComponent)
                self._materials.append(body.render_shapes[0].material)
            self._textures = {("planks", "oak"): self._materials[0].base_color_texture}

    def paint(self, backdrop: Backdrop) -> Colour:
        """Show a backdrop; the mean colour of the table top."""
        if self._materials and backdrop != self.backdrop:
            table, wall = self._materials
            look = backdrop.table, backdrop.colour
            if look not in self._textures:
                self._textures[look] = _shaded(PAINTS[backdrop.colour], shade(backdrop.table))
            table.base_color_texture = self._textures[look]
            wall.base_color = [*PAINTS[backdrop.wall], 1.0]
        self.backdrop = backdrop
        return PAINTS[backdrop.colour]
