#!/usr/bin/env python3
"""The pictures of docs/operators.md: each operator at three values in one scene, the tasks, and the objects.

Only fair scenes are drawn, and one machine draws the same bytes every time. LIBERO's need `.venv-libero`. With
`--only robots`, that of docs/packs.md, which needs the robots' files in VLAFUZZ_PACKS.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from vlafuzz.model import Conditions, Placement, Scene
from vlafuzz.model.scene import in_words
from vlafuzz.model.space import value_at
from vlafuzz.policies.base import CameraRequest, PolicySpec
from vlafuzz.policies.controls import Frozen
from vlafuzz.worlds import world_of
from vlafuzz.worlds.events import begins
from vlafuzz.worlds.manipulation.camera import camera_pose
from vlafuzz.worlds.manipulation.rigs import PANDA
from vlafuzz.worlds.manipulation.space import TableSpace
from vlafuzz.worlds.recording import Recording
from vlafuzz.worlds.tabletop.objects import load_catalogue
from vlafuzz.worlds.tabletop.tasks import TASKS

SIDE, LINE, GAP = 256, 20, 4  # of a picture, a line of its caption, and between two pictures; pixels
QUALITIES, MOST = (80, 65, 50, 40), 25_000  # of JPEG: the first with a file of fewer bytes
HZ, LATE = 5, 8  # frames a second of a rollout, and the one in which a delay of commands is seen
AFTER = 4  # frames after which what an event moves is at rest
DRAWN = Path(__file__).with_suffix(".yaml")
OUT = Path(__file__).parent.parent / "docs" / "pictures"
Picture = NDArray[np.uint8]
Panel = tuple[Picture, str]


class Eye(Frozen):
    """Asks for one picture and never moves."""

    def __init__(self, side: int = SIDE) -> None:
        self.spec = PolicySpec("eye", cameras=(CameraRequest("front", side, side),))


class Studio:
    """Draws fair scenes of one task."""

    def __init__(self, task: str, robot: str | None = None) -> None:
        self.world = world_of(task)
        robot = robot or next(iter(self.world.robots))
        space = self.world.space(task, robot)
        assert isinstance(space, TableSpace)
        self.space, self.conditions = space, Conditions(task=task, robot=robot)

    def scene(self, values: Mapping[str, Any]) -> Scene:
        """The nominal scene with some values changed; ``low`` and ``high`` stand for the ends of a range."""
        grids = {path: self.space.by_path[path].grid for path in values}
        ends = {path: {"low": grid.low, "high": grid.high} for path, grid in grids.items()}
        chosen = {path: ends[path].get(value, value) for path, value in values.items()}
        return self.space.compose({**self.space.values(self.space.nominal()), **chosen})

    def words(self, scene: Scene, values: Mapping[str, Any]) -> str:
        """The changed values as a user reads them."""
        parts = []
        for path in values:
            value = scene.instruction if path == "instruction" else value_at(scene, path)
            if path == "confounders":
                parts += [f"{value} more"] if len(values) == 1 else []
            elif isinstance(value, str):
                parts.append(value.replace("_", " "))
            else:
                parts.append(in_words(path, round(value, 3)).replace("×", "x"))  # Pillow's own font has no ×
        composed = self.space.values(scene)
        usual = all(
            composed[path] == self.space.by_path[path].grid.nominal
            for path in values
            if path != "confounders" or len(values) == 1
        )
        return "nominal: " * usual + ", ".join(parts)

    def seen(self, scenes: Sequence[Scene], side: int = SIDE, *, fair: bool = True) -> Iterator[Picture]:
        """What a policy's camera shows at the start.

        Raises:
            SystemExit: a scene is not fair.
        """
        evaluator = self.world.evaluator(self.conditions, Eye(side), self.space, recording=None, checked=False)
        with closing(evaluator):
            for scene in scenes:
                problem = evaluator.check(scene) if fair else None
                if problem is not None:
                    raise SystemExit(f"{scene.to_json()} is not fair: {problem.reason}")
                yield evaluator.begin(scene, 0).observe().images["front"]

    def rolled_out(self, scene: Scene) -> list[Picture]:
        """The expert's rollout, ``HZ`` frames a second."""
        expert = self.world.solvers()["expert"]
        hz = self.world.robot(self.conditions.robot).control_hz or expert.spec.action.hz
        recording = Recording(SIDE, stride=max(1, round(hz / HZ)))
        evaluator = self.world.evaluator(self.conditions, expert, self.space, recording=recording, checked=True)
        with closing(evaluator):
            (outcome,) = evaluator.evaluate([scene])
        self.trace = outcome.rollouts[0].trace
        return recording.frames

    def event(self, scene: Scene) -> Iterator[Panel]:
        """What the expert's rollout shows when the event of a scene begins, shortly after, and at the end."""
        ((part, event),), frames = scene.events.items(), self.rolled_out(scene)
        begun = begins(event, self.trace, self.space.task.stage_names, HZ)
        assert begun is not None
        for frame, when in (
            (begun, "begins"),
            (begun + AFTER, f"{AFTER / HZ:g} s later"),
            (-1, "the expert in the end"),
        ):
            yield frames[frame], f"{part.replace('_', '-')}: {when}"

    def operator(self, name: str, values: Sequence[Mapping[str, Any]]) -> Image.Image:
        """The pictures of an operator, each above its values."""
        scenes = [self.scene(one) for one in values]
        if name == "events":
            return strip([panel for scene in scenes for panel in self.event(scene)])
        late = name == "control-latency"  # at the start nothing of it is to be seen
        pictures = [self.rolled_out(scene)[LATE] for scene in scenes] if late else list(self.seen(scenes))
        words = [self.words(scene, one) for scene, one in zip(scenes, values, strict=True)]
        return strip(list(zip(pictures, words, strict=True)))


def strip(panels: Sequence[Panel], columns: int = 3) -> Image.Image:
    """Pictures in rows, each above its caption."""
    width, height = SIDE + GAP, SIDE + LINE
    rows = -(-len(panels) // columns)
    sheet = Image.new("RGB", (columns * width - GAP, rows * height), "white")
    draw = ImageDraw.Draw(sheet)
    for index, (picture, words) in enumerate(panels):
        left, top = index % columns * width, index // columns * height
        sheet.paste(Image.fromarray(picture).resize((SIDE, SIDE)), (left, top))
        size = next(size for size in range(13, 5, -1) if draw.textlength(words, ImageFont.load_default(size)) < SIDE)
        draw.text((left + SIDE / 2, top + SIDE + 2), words, "black", ImageFont.load_default(size), anchor="ma")
    return sheet


def objects() -> Image.Image:
    """All objects of the tabletop, each in its first rest pose in the middle of the table."""
    studio, catalogue, side = Studio("pick-up"), load_catalogue(), 3 * SIDE
    studio.conditions = replace(studio.conditions, world={"quality": "full"})  # with shadows
    names = catalogue.names()
    poses = [catalogue[name].stable_poses[0].name for name in names]
    nominal = studio.scene({})
    alone = [
        replace(nominal, targets=(Placement(name, pose, 0.0, 0.0, 30.0),))
        for name, pose in zip(names, poses, strict=True)
    ]
    ((u, v),), _ = camera_pose(PANDA.view).project(np.array([[0.0, 0.0, 0.03]]))
    left, top, half = round(u * side), round(v * side), SIDE // 2
    pictures = studio.seen(alone, side, fair=False)  # plates and cloths are nothing to pick up
    crops = [picture[top - half : top + half, left - half : left + half] for picture in pictures]
    return strip([(crop, name.replace("_", " ")) for crop, name in zip(crops, names, strict=True)], columns=5)


def robots() -> Image.Image:
    """The two robots of VLATest with a thing in the hand, from the rollouts of the expert."""
    frames = [
        frames[round(share * (len(frames) - 1))]
        for robot, task, share in (("widowx", "put-on", 0.5), ("google", "pick-up", 1.0))
        for studio in [Studio(task, robot)]
        for frames in [studio.rolled_out(studio.scene({}))]
    ]
    gap = np.full((SIDE, GAP, 3), 255, dtype=np.uint8)
    return Image.fromarray(np.concatenate([frames[0], gap, frames[1]], axis=1))


def tasks() -> Iterator[tuple[str, Image.Image]]:
    """The expert's rollout in the nominal scene of each task of the tabletop."""
    for task in TASKS:
        studio = Studio(task)
        scene = studio.scene({})
        frames = studio.rolled_out(scene)
        chosen = [frames[index] for index in (0, len(frames) // 2, -1)]
        captions = (f"“{scene.instruction}”", "the expert on its way", "success")
        yield task, strip(list(zip(chosen, captions, strict=True)))


def save(picture: Image.Image, name: str, out: Path, scale: float = 1.0) -> None:
    path, size = out / f"{name}.jpg", (round(picture.width * scale), round(picture.height * scale))
    resized = picture.resize(size, Image.Resampling.LANCZOS)
    for quality in QUALITIES:
        resized.save(path, quality=quality, optimize=True)
        if path.stat().st_size < MOST:
            break
    print(f"{path}: {path.stat().st_size / 1000:.0f} kB")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("task", choices=("pick-up", "libero_object/0"), help="whose operators to draw")
    parser.add_argument("--only", nargs="*", default=[], help="these operators, `tasks`, `objects` or `robots`")
    parser.add_argument("--out", type=Path, default=OUT, help="folder for the JPEGs")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    drawn, studio = yaml.safe_load(DRAWN.read_text()), Studio(options.task)
    prefix = "libero-" if options.task.startswith("libero") else ""
    for name, values in (drawn["everywhere"] | drawn[options.task]).items():
        if not options.only or name in options.only:
            save(studio.operator(name, values), prefix + name, options.out, scale=0.75 if name == "events" else 1.0)
    if prefix:
        return
    if not options.only or "tasks" in options.only:
        for task, picture in tasks():
            save(picture, task, options.out)
    if not options.only or "objects" in options.only:
        save(objects(), "objects", options.out, scale=0.6)
    if "robots" in options.only:
        save(robots(), "robots", options.out)


if __name__ == "__main__":
    main()
