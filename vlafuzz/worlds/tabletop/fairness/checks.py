"""Checks without a simulator whether a scene is fair. They never change a scene."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import chain, combinations

import numpy as np

from vlafuzz.common.text import ambiguous
from vlafuzz.model import Camera, Placement, Rejection, Scene
from vlafuzz.worlds.events import STOP, afterwards, impossible
from vlafuzz.worlds.manipulation.base import Visible
from vlafuzz.worlds.manipulation.camera import camera_pose
from vlafuzz.worlds.manipulation.rigs import RIGS, Hand, Rig, rig
from vlafuzz.worlds.tabletop.fairness.footprint import Footprint, apart, extents, footprint, solid
from vlafuzz.worlds.tabletop.fairness.visible import unseen
from vlafuzz.worlds.tabletop.objects.catalogue import Catalogue
from vlafuzz.worlds.tabletop.objects.model import ObjectModel
from vlafuzz.worlds.tabletop.tasks import TASKS, State, kind, task as task_named

OVERHANG = 0.35  # share of its length by which an object may overhang its support at each end
MARGIN = 0.004  # clearance on each side of an object inside a container, metres
DISH = 0.003  # height of a rim that keeps a rolling object in place, metres
IN_VIEW = 0.9  # least share of a target's hull vertices in the image; its centre must be in it as well
SLID = (0.25, 0.5, 0.75)  # of its way, where sliding things are looked at: every 3 cm of the longest
_ROUNDING = 1e-9


def check_static(
    scene: Scene, catalogue: Catalogue, min_distance: float, visible: Visible | None = None, *, outlines: bool = False
) -> Rejection | None:
    """Run the checks that need no simulator, cheapest first.

    ``min_distance``: of centres, metres. ``visible``: None to skip that check. ``outlines``: whether the policy gets
    outlines in flat colours instead of pictures.
    """
    rejection = check_semantic(scene, catalogue) or check_geometry(scene, catalogue, min_distance)
    if rejection or visible is None:
        return rejection
    problem = unseen(scene, catalogue, visible, outlines=outlines)
    return Rejection("unseen", problem) if problem else None


def check_events(scene: Scene, catalogue: Catalogue, min_distance: float, visible: Visible | None) -> Rejection | None:
    """Run the same checks on a scene, itself fair, after its events; a target that slides must not pass through things.

    Arguments: see ``check_static``.
    """
    if not scene.events:
        return None
    change = scene.instruction_change
    if lacking := sorted(scene.events.keys() & {"target_knock", "target_switch"}):
        return Rejection("semantic", f"{lacking[0].replace('_', '-')}: the tabletop has no such event")
    if problem := impossible(scene):
        return Rejection("semantic", problem)
    if change.to == STOP and change.when != "approach" and task_named(scene.task).targets == 1:
        # what is in the hand by then, and a second later in the air, is there if one goes on as well
        return Rejection("semantic", f"instruction-change: {scene.task} may end as after {STOP!r} at the {change.when}")
    late = afterwards(scene)
    rejection = check_static(late, catalogue, min_distance, visible)
    if rejection is not None:
        return Rejection(rejection.check, f"after its events: {rejection.reason}")
    for share in SLID:
        rejection = check_geometry(afterwards(scene, share), catalogue, 0.0)
        if rejection is not None:
            return Rejection(rejection.check, f"while things slide: {rejection.reason}")
    return None


def check_semantic(scene: Scene, catalogue: Catalogue) -> Rejection | None:
    """Check the values of a scene apart from the positions."""
    problem = next(_problems(scene, catalogue), None)
    return Rejection("semantic", problem) if problem else None


def _problems(scene: Scene, catalogue: Catalogue) -> Iterator[str]:
    """The problems in a sentence each. Only the first is used: later checks assume that there is none."""
    if kind(scene.task) not in TASKS:
        yield f"unknown task {scene.task!r}"
    if scene.robot not in RIGS:
        yield f"unknown robot {scene.robot!r}"
    if not scene.instruction.strip():
        yield "an instruction is empty"
    if scene.light.intensity < 0:
        yield f"light: an intensity of {scene.light.intensity:g} is negative"
    task = task_named(scene.task)
    if len(scene.targets) != task.targets:
        yield f"{task.name} names {task.targets} target(s), the scene has {len(scene.targets)}"
    for placement in scene.placements:
        yield from _placement_problems(placement, catalogue)
    models = [catalogue[placement.object] for placement in scene.placements]
    for a, b in combinations(models, 2):
        if ambiguous(a.spoken, b.spoken):
            yield f"{a.spoken!r} and {b.spoken!r} cannot be told apart by name"
    first, *more = zip(scene.targets, models, strict=False)
    problem = cannot_grasp(*first, rig(scene.robot).hand)
    if problem or (task.onto and (problem := cannot_place(task.onto, *first, *more[0]))):
        yield problem


def _placement_problems(placement: Placement, catalogue: Catalogue) -> Iterator[str]:
    if placement.object not in catalogue:
        yield f"unknown object {placement.object!r}"
    if not placement.scale > 0:
        yield f"{placement.object}: a scale of {placement.scale:g} is not positive"
    if placement.quaternion is not None:
        if not math.isclose(math.hypot(*placement.quaternion), 1.0, abs_tol=1e-3):
            yield f"{placement.object}: the quaternion {placement.quaternion} is not of length 1"
    elif placement.rest not in (known := [pose.name for pose in catalogue[placement.object].stable_poses]):
        yield f"{placement.object}: unknown rest pose {placement.rest!r}, it has {', '.join(known)}"


def cannot_grasp(a: Placement, model: ObjectModel, hand: Hand) -> str | None:
    """Why a gripper cannot grasp an object from above; None for raw orientations, which have no grasps."""
    if model.role != "graspable":
        return f"{model.spoken} is not graspable"
    if a.quaternion is not None:
        return None
    grasps = [(grasp.width * a.scale, grasp.z * a.scale) for grasp in model.stable_pose(a.rest).grasps]
    if not any(hand.takes(*grasp) for grasp in grasps):
        width, height = min(grasps, default=(0.0, 0.0))
        if grasps and height > hand.highest:
            lifts = f"the hand can lift from at most {hand.highest:g} m"
            return f"{model.spoken}, {a.rest}, is grasped at a height of {height:.3f} m: {lifts}"
        problem = f"{width:.3f} m wide" if grasps else "without a grasp"
        least = f"{hand.thinnest:g} to" if hand.thinnest else "up to"
        return f"{model.spoken}, {a.rest}, is {problem}: the gripper takes {least} {hand.widest:g} m"
    return None


def cannot_place(onto: str, a: Placement, model_a: ObjectModel, b: Placement, model_b: ObjectModel) -> str | None:
    """Why ``a`` in its orientation cannot stay on the ``support`` or in the ``container`` ``b``."""
    a, b = (replace(placement, x=0.0, y=0.0, yaw=0.0) for placement in (a, b))
    return _cannot_place(onto, a, model_a, b, model_b)


@lru_cache(maxsize=4096)
def _cannot_place(onto: str, a: Placement, model_a: ObjectModel, b: Placement, model_b: ObjectModel) -> str | None:
    if onto == "container":
        return _cannot_put_in(a, model_a, b, model_b)
    if not model_b.supports:
        return f"nothing can be put on {model_b.spoken}"
    tops = [float(part[:, 2].max()) for part in model_b.parts]
    dished = max(tops) - min(tops) >= DISH
    if a.quaternion is None and model_a.stable_pose(a.rest).rolls and not dished:
        return f"{model_a.spoken}, {a.rest}, rolls off {model_b.spoken}"
    sides = extents(footprint(a, model_a).polygon)
    short, long = float(sides.min()), float(sides.max())
    width = float(extents(footprint(b, model_b).polygon).min())
    if short > width or long * (1 - 2 * OVERHANG) > width:
        size = f"{long:.3f} x {short:.3f} m"
        return f"{model_a.spoken}, {size}, is too large for {model_b.spoken}, {width:.3f} m across"
    return None


def _cannot_put_in(a: Placement, model_a: ObjectModel, b: Placement, model_b: ObjectModel) -> str | None:
    container = model_b.container
    if container is None:
        return f"nothing can be put into {model_b.spoken}"
    inside = np.array([container.width, container.depth]) * b.scale - 2 * MARGIN
    if not np.any(np.all(extents(footprint(a, model_a).polygon) <= inside, axis=1)):
        size = f"{container.width:g} x {container.depth:g} m inside"
        lies = f", {a.rest}," if a.rest else ""  # raw orientations have no name
        return f"{model_a.spoken}{lies} does not fit into {model_b.spoken}, {size}"
    return None


def check_geometry(scene: Scene, catalogue: Catalogue, min_distance: float) -> Rejection | None:
    """Check the positions in a scene that passes ``check_semantic``. ``min_distance``: of centres, metres."""
    setup = rig(scene.robot)
    models = [catalogue[placement.object] for placement in scene.placements]
    outlines = [footprint(*pair) for pair in zip(scene.placements, models, strict=True)]
    named = list(zip((model.spoken for model in models), outlines, strict=True))
    targets = zip(scene.targets, models, strict=False)
    problems = chain(
        (off_workspace(*one, setup) for one in named),
        (out_of_reach(*one, setup) for one in named[: len(scene.targets)]),
        (too_close(a, b, min_distance) for a, b in combinations(named, 2)),
        (out_of_view(*target, setup, scene.camera) for target in targets),
    )
    return next((Rejection("geometry", problem) for problem in problems if problem), None)


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


SECONDS = 1.0
MOVED = 0.01  # metres
TIPPED = np.cos(np.radians(15.0))
FALLEN = -0.1  # metres


def unsettled(scene: Scene, models: tuple[ObjectModel, ...], before: State, after: State) -> Rejection | None:
    """Why objects do not stay in place for a second, or the task is solved at once; None for a fair scene."""
    if rejection := _restless(scene.placements, before, after):
        return rejection
    judged = task_named(scene.task)
    for moment, state in (("at the start", before), ("after settling", after)):
        if judged.solved(models, state):
            return Rejection("solved", f"{judged.name} is solved {moment}, before the policy acts")
    return None


def _restless(placements: Sequence[Placement], before: State, after: State) -> Rejection | None:
    for index, placement in enumerate(placements):
        end, reason = after.positions[index], ""
        distance = float(np.linalg.norm(end - before.positions[index]))
        vertical = float(before.rotations[index][2] @ after.rotations[index][2])
        if not np.all(np.isfinite(end)):
            reason = "has no finite position after settling"
        elif end[2] < FALLEN:
            reason = f"fell to z = {end[2]:.2f} m"
        elif distance > MOVED:
            reason = f"moved {distance * 100:.1f} cm while settling, more than {MOVED * 100:.0f} cm"
        elif vertical < TIPPED:
            tilt = np.degrees(np.arccos(np.clip(vertical, -1, 1)))
            reason = f"tipped by {tilt:.0f} degrees while settling"
        if reason:
            where = f"{placement.object} at ({placement.x:.3f}, {placement.y:.3f})"
            return Rejection("settling", f"{where} {reason}")
    return None
