#!/usr/bin/env python3
"""Render every object of a catalogue in all its stable poses, at one scale, onto one labelled picture."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import sapien
from PIL import Image, ImageDraw, ImageFont

from vlafuzz.worlds.tabletop.objects import ObjectModel, StablePose, load_catalogue, open_packs
from vlafuzz.worlds.tabletop.sim.world import looks

CELL = 256
COLUMNS = 6
FINER = 2  # supersampling factor


class Studio:
    """A table, lights and a camera, for one object at a time."""

    def __init__(self) -> None:
        self.scene = sapien.Scene([sapien.render.RenderSystem()])
        self.scene.set_ambient_light([0.45, 0.45, 0.45])
        self.scene.add_directional_light([-0.5, 0.5, -1.0], [1.6, 1.6, 1.6], shadow=True)
        self.scene.add_directional_light([-0.6, -0.8, -0.6], [0.5, 0.5, 0.5])
        table = sapien.Entity()
        body = sapien.render.RenderBodyComponent()
        paint = sapien.render.RenderMaterial(base_color=[0.52, 0.50, 0.47, 1.0], roughness=0.9)
        body.attach(sapien.render.RenderShapeBox([0.8, 0.8, 0.05], paint))
        table.add_component(body)
        table.pose = sapien.Pose([0, 0, -0.05])
        self.scene.add_entity(table)
        self.camera = self.scene.add_camera("camera", CELL * FINER, CELL * FINER, np.radians(30), 0.05, 5.0)
        backwards, down = sapien.Pose(q=[0, 0, 0, 1]), sapien.Pose(q=[np.cos(0.31), 0, np.sin(0.31), 0])
        self.camera.entity.pose = sapien.Pose([0.46, 0, 0.41]) * backwards * down

    def photograph(self, model: ObjectModel, pose: StablePose, yaw: float) -> Image.Image:
        """An image of ``CELL`` pixels, with the object turned by ``yaw`` degrees."""
        entity = sapien.Entity()
        visual = sapien.render.RenderBodyComponent()
        visual.attach(looks(model))
        entity.add_component(visual)
        half = np.radians(yaw) / 2
        turn = sapien.Pose(q=[np.cos(half), 0, 0, np.sin(half)])
        entity.pose = sapien.Pose([0, 0, pose.height]) * turn * sapien.Pose(q=pose.quaternion)
        self.scene.add_entity(entity)
        self.scene.update_render()
        self.camera.take_picture()
        colour = np.clip(self.camera.get_picture("Color")[..., :3], 0, 1)
        self.scene.remove_entity(entity)
        picture = Image.fromarray((colour * 255).astype(np.uint8))
        return picture.resize((CELL, CELL), Image.Resampling.LANCZOS)


def sheet(pictures: list[tuple[str, Image.Image]]) -> Image.Image:
    """The pictures in rows, with labels below."""
    line = 26
    rows = -(-len(pictures) // COLUMNS)
    page = Image.new("RGB", (COLUMNS * CELL, rows * (CELL + line)), (250, 250, 248))
    draw, font = ImageDraw.Draw(page), ImageFont.load_default(15)
    for i, (words, picture) in enumerate(pictures):
        x, y = i % COLUMNS * CELL, i // COLUMNS * (CELL + line)
        page.paste(picture, (x, y))
        draw.text((x + CELL / 2, y + CELL + line / 2), words, (30, 30, 30), font, anchor="mm")
    return page


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("contact_sheet.png"), help="PNG to write")
    parser.add_argument("--objects", type=Path, help="a catalogue file instead of the built-in one")
    parser.add_argument("--pack", nargs="*", default=[], help="show the objects of these packs only")
    parser.add_argument("--yaw", type=float, default=15.0, help="degrees by which every object is turned")
    options = parser.parse_args()
    studio = Studio()
    catalogue = load_catalogue(options.objects, packs=[pack for path in options.pack for pack in open_packs(path)])
    pictures = [
        (f"{model.spoken}, {pose.name.replace('_', ' ')}", studio.photograph(model, pose, options.yaw))
        for model in map(catalogue.__getitem__, catalogue.preferred(catalogue.names()))
        for pose in model.stable_poses
    ]
    sheet(pictures).save(options.out)
    print(options.out)


if __name__ == "__main__":
    main()
