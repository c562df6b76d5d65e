"""Whether a scene of LIBERO is fair: it has no defect that the suite's own initial state does not have."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache, lru_cache, partial

import numpy as np

from vlafuzz.common.arrays import Array
from vlafuzz.errors import SceneError
from vlafuzz.model import Light, Placement, Rejection, Scene
from vlafuzz.model.scene import EXTRAS
from vlafuzz.worlds.events import NUMBERS, afterwards, impossible, without
from vlafuzz.worlds.libero.casts import about, switches
from vlafuzz.worlds.libero.defects import Defect, defects
from vlafuzz.worlds.libero.env import LiberoEnv
from vlafuzz.worlds.libero.grasps import surface
from vlafuzz.worlds.libero.packages import load
from vlafuzz.worlds.libero.room import REACH, room_of
from vlafuzz.worlds.libero.setting import VIEW, Setting
from vlafuzz.worlds.libero.space import LACKING, nominal_scene
from vlafuzz.worlds.libero.suites import LYING, REST, find_task

# By checks of defects those of scenes. A scene's places may be outside the suite's regions.
CHECKS = {
    "overlaps": "geometry",
    "slides": "settling",
    "falls": "settling",
    "moving": "settling",
    "solved": "solved",
    "premise": "semantic",
}
POINTS = 120  # of a thing's surface
UNSEEN = 0.4  # of what the camera shows of a thing in the initial state, at least
SLID = (1.0, 0.5)  # of its way, where what slides is looked at
KEPT = 512  # verdicts
_PICTURED = np.array([0, 1, 0, 0, 0, 0], dtype=np.uint8)  # groups of shapes that pictures show


class Fairness:
    """Judges scenes of a task. ``of`` gives where a scene is set up, whose state is changed."""

    def __init__(self, of: Callable[[Scene], Setting]) -> None:
        self._of = of
        self._judged = lru_cache(KEPT)(self._judge)
        self._usual = cache(self._look_at)

    def check(self, scene: Scene) -> Rejection | None:
        """Why a scene is not fair; None if it is."""
        nominal = nominal_scene(scene.task, scene.robot)
        if problem := _unknown(nominal, scene):
            return Rejection("semantic", problem)
        # the rest of a scene decides nothing here
        judged = ("targets", "confounders", "start", "initial_pose", "camera")
        first = without(scene, scene.events)
        usual = replace(nominal, light=Light(), target_switch=scene.target_switch)
        seen = replace(usual, **{part: getattr(first, part) for part in judged})
        rejection = self._judged(seen, replace(usual, start=scene.start))
        if rejection is None and scene.events:
            late = (self.check(afterwards(scene, share)) for share in SLID)
            rejection = next((Rejection(bad.check, f"after its events: {bad.reason}") for bad in late if bad), None)
        return rejection

    def _judge(self, scene: Scene, own: Scene) -> Rejection | None:
        """The first defect of a scene that its initial state does not have."""
        try:
            setting = self._of(scene)
            setting.begin(scene)
            known, before = self._usual(own)
        except SceneError as error:
            return Rejection("semantic", error.message)
        if scene == own:
            return None
        for thing, away in room_of(scene.task).out_of_reach(scene).items():
            name = scene.targets[thing].object
            return Rejection("geometry", f"{name} is {away:.2f} m from the robot, which reaches {REACH:g} m")
        for defect in _defects(setting, scene):
            if defect.check in CHECKS and defect.kind not in known:
                return Rejection(CHECKS[defect.check], defect.reason)
        for thing, share in _shown(setting, scene).items():
            if share < UNSEEN * before[thing]:
                name = scene.targets[thing].object
                reason = f"the camera shows {share:.0%} of {name}, usually {before[thing]:.0%}"
                return Rejection("unseen", reason)
        return None

    def _look_at(self, own: Scene) -> tuple[set[tuple[str, str]], dict[int, float]]:
        """The kinds of an initial state's own defects, and what the camera shows of its things."""
        setting = self._of(own)
        return {defect.kind for defect in _defects(setting, own)}, _shown(setting, own)


def _unknown(nominal: Scene, scene: Scene) -> str | None:
    """The first part of a scene that LIBERO's scenes do not have: nothing of a scene may be ignored."""
    for part in LACKING:
        if getattr(scene, part.replace("-", "_")) != EXTRAS[part.replace("-", "_")]:
            return f"{part}: scenes of {nominal.task} have none of their own"
    if scene.instruction_change.to in NUMBERS:
        return f"instruction-change: it names no other thing in {nominal.task}"
    if problem := impossible(scene):
        return problem
    if scene.target_switch.to != "same":
        if scene.target_switch.to not in NUMBERS or not switches(find_task(scene.task)):
            return f"target-switch: nothing else of its class stands there in {scene.task}"
        moves = {"target_slide", "target_knock"} if scene.target_switch.when == "start" else set[str]()
        if with_it := scene.events.keys() & {"instruction_change", *moves}:
            return f"target-switch: with {', '.join(with_it)}, nobody could say what happens to which thing"
    fallen, *others = scene.placements
    upright = (replace(fallen, rest=REST), *others) if fallen.rest == LYING else scene.placements
    if not all(one == Placement(one.object, REST, one.x, one.y, one.yaw) for one in upright):
        return "things: LIBERO's have one size, and rest as LIBERO places them"
    return f"light: an intensity of {scene.light.intensity:g}" if scene.light.intensity < 0 else None


def _defects(setting: Setting, scene: Scene) -> list[Defect]:
    return list(defects(setting.env, partial(setting.begin, scene)))


def _shown(setting: Setting, scene: Scene) -> dict[int, float]:
    """The share of the surface of each thing that a scene is about that the camera shows, by its number."""
    setting.begin(scene)
    env = setting.env
    things = about(find_task(scene.task), scene)
    return {thing: _share(env, env.bodies[scene.targets[thing].object]) for thing in things}


def _share(env: LiberoEnv, root: int) -> float:
    """The share of a body's surface that is in the picture, with nothing before it."""
    points, camera = surface(env, root, POINTS), env.data.camera(VIEW)
    eye = camera.xpos
    right, up, back = ((points - eye) @ camera.xmat.reshape(3, 3)).T
    half = np.tan(np.radians(env.model.camera(VIEW).fovy[0]) / 2) * -back
    inside = (back < 0) & (np.abs(right) < half) & (np.abs(up) < half)
    seen = [_first_hit(env, eye, point - eye) == root for point in points[inside]]
    return float(sum(seen)) / len(points)


def _first_hit(env: LiberoEnv, eye: Array, way: Array) -> int | None:
    """The first body in a direction, with all that hangs on it."""
    hit = np.zeros(1, dtype=np.int32)
    load("mujoco").mj_ray(env.model, env.data, eye, way / np.linalg.norm(way), _PICTURED, 1, -1, hit)
    return int(env.model.body_rootid[env.model.geom_bodyid[hit[0]]]) if hit[0] >= 0 else None
