"""Quantities of a scene on the table: how its targets look in the policy's first picture, and what is near them."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from pydantic import TypeAdapter

from vlafuzz.common.arrays import Array
from vlafuzz.common.reading import read_yaml, validated
from vlafuzz.errors import CatalogueError
from vlafuzz.model import Scene
from vlafuzz.model.quantities import Quantity
from vlafuzz.worlds.manipulation.rigs import rig
from vlafuzz.worlds.tabletop.fairness.visible import Picture
from vlafuzz.worlds.tabletop.objects.catalogue import Catalogue

HALF = 0.5  # of what is seen of a target differs at least so much from what is around it
_TARGET = "the target"
_OTHER = "the second target"
_FILE = Path(__file__).with_name("quantities.yaml")
_OF_TARGET = validated(TypeAdapter(dict[str, Quantity]), read_yaml(_FILE, CatalogueError), _FILE, CatalogueError)
_NEAREST = Quantity("confounders are ≥ {} from the target", "a confounder is ≤ {} from the target", " m", 0.001)


def quantities_of(targets: int) -> dict[str, Quantity]:
    """The quantities of scenes with so many targets, by name; of the second one with ``-2`` behind it."""
    second = {
        f"{name}-2": replace(one, above=one.above.replace(_TARGET, _OTHER), below=one.below.replace(_TARGET, _OTHER))
        for name, one in _OF_TARGET.items()
    }
    return {**_OF_TARGET, **(second if targets > 1 else {}), "nearest": _NEAREST}


def places(picture: Picture, targets: int) -> Array:
    """``(targets, 2)`` where the targets appear: pixels right and down."""
    return np.array([picture.place(index) for index in range(targets)])


def measured(scene: Scene, catalogue: Catalogue, usual: Array) -> dict[str, float]:
    """The quantities of a scene, in 2 ms; ``usual``: the ``places`` of the nominal scene."""
    picture = Picture(scene, catalogue)
    found: dict[str, float] = {}
    for index in range(len(scene.targets)):
        suffix = f"-{index + 1}" if index else ""
        for name, value in _of_target(picture, scene, index, usual[index]).items():
            found[name + suffix] = value
    first = scene.targets[0]
    away = [math.hypot(other.x - first.x, other.y - first.y) for other in scene.confounders]
    return {**found, "nearest": min(away, default=math.inf)}


def _of_target(picture: Picture, scene: Scene, index: int, usual: Array) -> dict[str, float]:
    right, down = (picture.place(index) - usual).tolist()
    hidden, (colours, areas) = picture.hidden(index), picture.colours(index)
    bright = float(np.average(colours.mean(axis=1), weights=areas)) if len(colours) else math.nan
    seems, is_ = picture.seems(index)
    base, target = rig(scene.robot).base, scene.targets[index]
    return {
        "right": right,
        "down": down,
        "aside": 100 * math.dist(seems, is_),
        "depth": 100 * abs(math.hypot(*seems) - math.hypot(*is_)),
        "size": hidden.size,
        "brightness": bright,
        "contrast": picture.apart(index, HALF)[0],
        "hidden": 100 * (1 - hidden.inside * hidden.unhidden),
        "reach": math.hypot(target.x - base[0], target.y - base[1]),
    }
