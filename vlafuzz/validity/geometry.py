"""Whether a scene's objects have room, and whether the robot can reach and the camera see what matters."""

from __future__ import annotations

import math
from itertools import combinations

import numpy as np

from vlafuzz.objects.catalogue import Catalogue, ObjectModel
from vlafuzz.rigs.camera import camera_pose
from vlafuzz.rigs.rig import Rig
from vlafuzz.rigs.robots import rig
from vlafuzz.scene import Camera, Placement, Scene
from vlafuzz.validity.footprint import Footprint, apart, footprint, solid
from vlafuzz.validity.report import Rejection

IN_VIEW = 0.9  # share of a target's hull vertices that must be in the picture; its centre must be as well
_ROUNDING = 1e-9


def check_geometry(scene: Scene, catalogue: Catalogue, min_distance: float) -> Rejection | None:
    """Judge where things are, in a scene that means something (see ``check_semantic``).

    Args:
        min_distance: between the centres of any two objects, metres.
    """
    setup = rig(scene.robot)
    models = [catalogue[placement.object] for placement in scene.placements]
    prints = [footprint(*pair) for pair in zip(scene.placements, models, strict=True)]
    named = list(zip((model.spoken for model in models), prints, strict=True))
    problems = (
        *(off_workspace(name, print_, setup) for name, print_ in named),
        *(out_of_reach(name, print_, setup) for name, print_ in named[: len(scene.targets)]),
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
    """Why an outline is not wholly inside the workspace, or what else of the table there is to stand on."""
    space = setup.surface or setup.workspace
    low, high = outline.polygon.min(axis=0), outline.polygon.max(axis=0)
    for axis, (first, last), start, end in zip("xy", (space.x, space.y), low, high, strict=True):
        if start < first - _ROUNDING or end > last + _ROUNDING:
            covered = f"covers {axis} from {start:.3f} to {end:.3f} m"
            return f"{name}: {covered}, the workspace ends at {first:g} and {last:g} m"
    return None


def out_of_reach(name: str, outline: Footprint, setup: Rig) -> str | None:
    """Why the robot's hand does not get to an object's centre."""
    distance = math.dist(outline.centre, setup.base[:2])
    if distance > setup.reach:
        return f"{name}: {distance:.3f} m from the {setup.robot}'s base, its reach is {setup.reach:g} m"
    return None


def too_close(a: Named, b: Named, min_distance: float) -> str | None:
    """Why two objects have not enough room between them."""
    distance = math.dist(a[1].centre, b[1].centre)
    if distance < min_distance - _ROUNDING:
        return f"{a[0]} and {b[0]}: {distance:.3f} m between their centres, less than {min_distance:g} m"
    if not apart(a[1], b[1]):
        return f"{a[0]} and {b[0]}: their footprints overlap"
    return None


def out_of_view(placement: Placement, model: ObjectModel, setup: Rig, camera: Camera) -> str | None:
    """Why the camera does not see an object: its centre and ``IN_VIEW`` of its hull vertices must be."""
    points = solid(placement, model)
    middle = (placement.x, placement.y, points[:, 2].max() / 2)
    uv, depth = camera_pose(setup.view, camera).project(np.vstack([points, middle]))
    seen = np.all((uv >= 0) & (uv <= 1), axis=1) & (depth > 0)
    share = float(seen[:-1].mean())
    if share < IN_VIEW or not seen[-1]:
        return f"{model.spoken}: {share:.0%} of it is in view, {IN_VIEW:.0%} and its centre must be"
    return None
