"""Backdrop: paints the table top and the wall behind the robot, scene by scene."""

from __future__ import annotations

import numpy as np
import sapien
from numpy.typing import NDArray

from vlafuzz.scene import Backdrop
from vlafuzz.sim.maniskill.rendering import render_system
from vlafuzz.sim.maniskill.table import COLOUR, WALL_COLOUR, planks, shaded, texture

Colour = tuple[float, float, float]
PAINTS: dict[str, Colour] = {  # linear, like all colours of the catalogue
    "oak": COLOUR,
    "sage": WALL_COLOUR,
    "white": (0.80, 0.80, 0.76),
    "grey": (0.32, 0.32, 0.32),
    "black": (0.05, 0.05, 0.06),
    "red": (0.42, 0.12, 0.10),
    "green": (0.16, 0.33, 0.18),
    "blue": (0.12, 0.22, 0.40),
}


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


def shade(pattern: str, size: int = 256) -> NDArray[np.float64]:
    """``(size, size)`` shades of a pattern, about 1."""
    if pattern == "planks":
        return planks(size)
    row, column = np.indices((size, size)) * 16 // size
    if pattern == "checker":
        return np.where((row + column) % 2, 1.3, 0.7)
    if pattern == "stripes":
        return np.where(row % 2, 1.3, 0.7)
    if pattern == "speckle":
        spots = np.random.default_rng(11).random((size // 4, size // 4)) < 0.15
        return np.where(spots, 0.5, 1.1).repeat(4, axis=0).repeat(4, axis=1)
    return np.ones((size, size))


def _material(entity: sapien.Entity) -> sapien.render.RenderMaterial:
    body = entity.find_component_by_type(sapien.render.RenderBodyComponent)
    return body.render_shapes[0].material
