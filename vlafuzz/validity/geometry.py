"""Checks that objects stand apart in the workspace, and that robot and camera reach the targets."""

from __future__ import annotations

import math
from itertools import combinations

import numpy as np

from vlafuzz.objects.catalogue import Catalogue
from vlafuzz.objects.model import ObjectModel
from vlafuzz.rigs.camera import camera_pose
from vlafuzz.rigs.rig import Rig
from vlafuzz.rigs.robots import rig
from vlafuzz.scene import Camera, Placement, Scene
from vlafuzz.validity.footprint import Footprint, apart, footprint, solid
from vlafuzz.validity.report import Rejection

IN_VIEW = 0.9  # least share of a target's hull vertices in the image; its centre must be in it as well
_ROUNDING = 1e-9


def check_geometry(scene: Scene, catalogue: Catalogue, min_distance: float) -> Rejection | None:
    """Check the positions in a scene that passes ``check_semantic``.

    Args:
        min_distance: between the centres of any two objects, metres.
    """
    setup = rig(scene.robot)
    models = [catalogue[placement.object] for placement in scene.placements]
    outlines = [footprint(*pair) for pair in zip(scene.placements, models, strict=True)]
    named = list(zip((model.spoken for model in models), outlines, strict=True))
    problems = (
        *(off_workspace(name, outline, setup) for name, outline in named),
        *(out_of_reach(name, outline, setup) for name, outline in named[: len(scene.targets)]),
        *(too_close(a, b, min_distance) for a, b in combinations(named, 2)),
    )
    for problem in problems:
        if problem:
            return Rejection("geometry", problem)
    for placement, model in zip(scene.targets, models, strict=False):
        problem = out_of_view(placement, model, setup, scene.camera)
        if problem:
            return Rejection("geometry", problem)
    return None


Named = tuple[str, Footprint]


def off_workspace(name: str, outline: Footprint, setup: Rig) -> str | None:
    """Why an outline is not entirely inside the rig's surface or workspace."""
    space = setup.surface or setup.workspace
    low, high = outline.polygon.min(axis=0), outline.polygon.max(axis=0)
    for axis, (first, last), start, end in zip("xy", (space.x, space.y), low, high, strict=True):
        if start < first - _ROUNDING or end > last + _ROUNDING:
            covered = f"covers {axis} from {start:.3f} to {end:.3f} m"
            return f"{name}: {covered}, the workspace ends at {first:g} and {last:g} m"
    return None


def out_of_reach(name: str, outline: Footprint, setup: Rig) -> str | None:
    """Why the robot's hand does not reach an object's centre."""
    distance = math.dist(outline.centre, setup.base[:2])
    if distance > setup.reach:
        return f"{name}: {distance:.3f} m from the {setup.robot}'s base, its reach is {setup.reach:g} m"
    return None


def too_close(a: Named, b: Named, min_distance: float) -> str | None:
    """Why two objects are too close to each other."""
    distance = math.dist(a[1].centre, b[1].centre)
    if distance < min_distance - _ROUNDING:
        return f"{a[0]} and {b[0]}: {distance:.3f} m between their centres, less than {min_distance:g} m"
    if not apart(a[1], b[1]):
        return f"{a[0]} and {b[0]}: their footprints overlap"
    return None


def out_of_view(placement: Placement, model: ObjectModel, setup: Rig, camera: Camera) -> str | None:
    """Why an object is not in view: its centre and ``IN_VIEW`` of its hull vertices must be."""
    points = solid(placement, model)
    middle = (placement.x, placement.y, points[:, 2].max() / 2)
    uv, depth = camera_pose(setup.view, camera).project(np.vstack([points, middle]))
    seen = np.all((uv >= 0) & (uv <= 1), axis=1) & (depth > 0)
    share = float(seen[:-1].mean())
    if share < IN_VIEW or not seen[-1]:
        return f"{model.spoken}: {share:.0%} of it is in view; {IN_VIEW:.0%} and its centre must be"
    return None
