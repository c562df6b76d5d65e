#!/usr/bin/env python3
"""Pictures of random scenes that count as unseen, or as seen, to judge the bounds of ``visible`` by eye.

Each scene: the picture, and the surroundings of each target three times as large.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from itertools import count, islice
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from vlafuzz.model import Conditions, Scene
from vlafuzz.policies.controls import Frozen
from vlafuzz.worlds.manipulation.camera import camera_pose
from vlafuzz.worlds.manipulation.rigs import rig
from vlafuzz.worlds.recording import Recording
from vlafuzz.worlds.tabletop.fairness.visible import unseen
from vlafuzz.worlds.tabletop.objects import load_catalogue
from vlafuzz.worlds.tabletop.sim.env import ManiSkillEvaluator
from vlafuzz.worlds.tabletop.space import SearchSpace, load_operators
from vlafuzz.worlds.tabletop.tasks import TASKS

LINE, ZOOM = 15, 3
CATALOGUE = load_catalogue()


def scenes(task: str, seed: int, *, seen: bool) -> Iterator[tuple[Scene, str]]:
    """Random scenes that are otherwise fair, with the reason why they are unseen."""
    operators = load_operators()
    assert operators.visible is not None
    space = SearchSpace(replace(operators, visible=None), CATALOGUE, task)
    for number in count():
        scene = space.sample(np.random.default_rng([seed, tuple(TASKS).index(task), number]))
        problem = unseen(scene, CATALOGUE, operators.visible)
        if seen == (problem is None):
            yield scene, problem or f"{scene.instruction} (light × {scene.light.intensity:.3g})"


def cell(scene: Scene, words: str, stills: ManiSkillEvaluator, size: int) -> Image.Image:
    """The picture of a scene and crops around its targets, over a line of words."""
    picture = Image.fromarray(stills.begin(scene, 0).picture("recording"))
    page = Image.new("RGB", (3 * size + 8, size + LINE), (90, 60, 90))
    page.paste(picture, (0, 0))
    view, half = camera_pose(rig(scene.robot).view, scene.camera), size / ZOOM / 2
    for index, target in enumerate(scene.targets, start=1):
        ((u, v),), _ = view.project(np.array([[target.x, target.y, 0.03]]))
        box = [round(value) for value in (u * size - half, v * size - half, u * size + half, v * size + half)]
        crop = picture.crop((box[0], box[1], box[2], box[3]))
        page.paste(crop.resize((size, size), Image.Resampling.NEAREST), (index * (size + 2), 0))
    ImageDraw.Draw(page).text((2, size + 1), words, (255, 255, 255))
    return page


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("visibility.png"), help="PNG to write")
    parser.add_argument("--seen", action="store_true", help="seen scenes instead of unseen ones")
    parser.add_argument("--n", type=int, default=10, help="scenes a task")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--size", type=int, default=224, help="height of a picture, pixels")
    options = parser.parse_args()
    cells: list[Image.Image] = []
    for task in TASKS:
        recording = Recording(options.size)
        evaluator = ManiSkillEvaluator(Conditions(task=task), Frozen(), CATALOGUE, recording=recording)
        with closing(evaluator) as stills:
            chosen = islice(scenes(task, options.seed, seen=options.seen), options.n)
            cells += [
                cell(scene, f"{len(cells) + number} {words}", stills, options.size)
                for number, (scene, words) in enumerate(chosen)
            ]
    width, height = cells[0].size
    page = Image.new("RGB", (2 * width, -(-len(cells) // 2) * height))
    for number, picture in enumerate(cells):
        page.paste(picture, (number % 2 * width, number // 2 * height))
    page.save(options.out)
    print(options.out)


if __name__ == "__main__":
    main()
