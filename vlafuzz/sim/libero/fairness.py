"""Whether a scene of LIBERO is fair: it has no defect that the suite's own initial state does not have."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from vlafuzz.errors import SceneError
from vlafuzz.rigs.robots import LIBERO
from vlafuzz.scene import Light, Placement, Scene
from vlafuzz.sim.audit import Defect
from vlafuzz.sim.libero.audit import defects
from vlafuzz.sim.libero.env import LiberoEnv
from vlafuzz.sim.libero.grasps import surface
from vlafuzz.sim.libero.room import room_of
from vlafuzz.sim.libero.setting import VIEW, Setting
from vlafuzz.sim.libero.suites import REST
from vlafuzz.validity import Rejection

Array = NDArray[np.float64]
# The audit's checks by those of scenes.
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
KEPT = 512  # verdicts


class Fairness:
    """Judges scenes in one environment, whose state it changes."""

    def __init__(self, env: LiberoEnv, setting: Setting) -> None:
        self._env, self._setting = env, setting
        self._own: dict[int, tuple[set[tuple[str, str]], dict[str, float]]] = {}
        self._known: dict[Scene, Rejection | None] = {}

    def check(self, nominal: Scene, scene: Scene) -> Rejection | None:
        """Why a scene is not fair; None if it is. ``nominal``: without deviations, of any initial state."""
        if problem := _unknown(nominal, scene):
            return Rejection("semantic", problem)
        placed = replace(nominal, targets=scene.targets, start=scene.start, initial_pose=scene.initial_pose)
        seen = replace(placed, camera=scene.camera, light=Light())
        if seen not in self._known:
            if len(self._known) >= KEPT:
                self._known.clear()
            self._known[seen] = self._judged(nominal, seen)
        return self._known[seen]

    def _judged(self, nominal: Scene, scene: Scene) -> Rejection | None:
        try:
            self._setting.begin(scene)
        except SceneError as error:
            return Rejection("semantic", error.message)
        number = scene.start.state
        if number not in self._own:
            own = replace(nominal, start=scene.start)
            self._own[number] = ({kind_of(defect) for defect in self._defects(own)}, self._shown(own))
        known, usual = self._own[number]
        if scene == replace(nominal, start=scene.start):
            return None
        for thing, away in room_of(str(self._env.task)).out_of_reach(scene).items():
            name = self._env.task.things[thing]
            reason = f"{name} is {away:.2f} m from the robot, which reaches {LIBERO.reach:g} m"
            return Rejection("geometry", reason)
        for defect in self._defects(scene):
            if kind_of(defect) not in known:
                return Rejection(CHECKS[defect.check], defect.reason)
        for name, share in self._shown(scene).items():
            if share < UNSEEN * usual[name]:
                return Rejection(
                    "unseen", f"the camera shows {share:.0%} of {name}, usually {usual[name]:.0%}"
                )
        return None

    def _defects(self, scene: Scene) -> list[Defect]:
        return list(defects(self._env, scene.start.state, partial(self._setting.begin, scene), regions=False))

    def _shown(self, scene: Scene) -> dict[str, float]:
        """The share of the surface of each thing of interest that the camera shows."""
        self._setting.begin(scene)
        env = self._env
        return {name: _share(env, name) for name in env.task.things[: env.task.concerned]}


def _unknown(nominal: Scene, scene: Scene) -> str | None:
    """What a scene has and LIBERO's scenes do not; nothing of a scene may be ignored."""
    for part in ("confounders", "backdrop", "frame", "then"):
        if getattr(scene, part) != getattr(nominal, part):
            return f"{part}: scenes of {nominal.task} have none of their own"
    if not all(one == Placement(one.object, REST, one.x, one.y, one.yaw) for one in scene.targets):
        return "targets: LIBERO's things have one size, and rest as they do in the initial state"
    return f"light: an intensity of {scene.light.intensity:g}" if scene.light.intensity < 0 else None


def kind_of(defect: Defect) -> tuple[str, str]:
    """What is wrong with what, without the amount."""
    return defect.check, defect.reason.split(" by ")[0]


def _share(env: LiberoEnv, name: str) -> float:
    """The share of a thing's surface that is in the picture, with nothing before it."""
    root = env.robosuite.obj_body_id[name]
    points = surface(env, root, POINTS)
    camera = env.data.camera(VIEW)
    eye, axes = camera.xpos, camera.xmat.reshape(3, 3)
    right, up, back = ((points - eye) @ axes).T
    half = np.tan(np.radians(env.model.camera(VIEW).fovy[0]) / 2) * -back
    inside = (back < 0) & (np.abs(right) < half) & (np.abs(up) < half)
    seen = [_unhidden(env, eye, point, root) for point in points[inside]]
    return float(sum(seen)) / len(points)


def _unhidden(env: LiberoEnv, eye: Array, point: Array, root: int) -> bool:
    """Whether the first thing on the way from the eye to a point is what the point is on."""
    way = point - eye
    hit = np.zeros(1, dtype=np.int32)
    groups = np.array([0, 1, 0, 0, 0, 0], dtype=np.uint8)  # what pictures show
    env.ray(eye, way / np.linalg.norm(way), groups, hit)
    return bool(hit[0] >= 0 and env.model.body_rootid[env.model.geom_bodyid[hit[0]]] == root)
