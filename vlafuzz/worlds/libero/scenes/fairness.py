"""Whether a scene of LIBERO is fair: it has no defect that the suite's own initial state does not have."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from vlafuzz.errors import SceneError
from vlafuzz.model.outcome import Rejection
from vlafuzz.model.scene import Light, Placement, Scene
from vlafuzz.worlds.audit import Defect
from vlafuzz.worlds.libero.audit import defects
from vlafuzz.worlds.libero.env import LiberoEnv
from vlafuzz.worlds.libero.environments import Environments
from vlafuzz.worlds.libero.expert.grasps import surface
from vlafuzz.worlds.libero.scenes.room import room_of
from vlafuzz.worlds.libero.scenes.setting import VIEW, Setting
from vlafuzz.worlds.libero.suites import REST
from vlafuzz.worlds.manipulation.rigs.robots import LIBERO

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
    """Judges scenes in the environments of a task, whose states it changes."""

    def __init__(self, environments: Environments) -> None:
        self._environments = environments
        self._own: dict[int, tuple[set[tuple[str, str]], list[float]]] = {}
        self._known: dict[Scene, Rejection | None] = {}

    def check(self, nominal: Scene, scene: Scene) -> Rejection | None:
        """Why a scene is not fair; None if it is. ``nominal``: without deviations, of any initial state."""
        if problem := _unknown(nominal, scene):
            return Rejection("semantic", problem)
        placed = replace(
            nominal,
            targets=scene.targets,
            confounders=scene.confounders,
            start=scene.start,
            initial_pose=scene.initial_pose,
        )
        seen = replace(placed, camera=scene.camera, light=Light())
        if seen not in self._known:
            if len(self._known) >= KEPT:
                self._known.clear()
            self._known[seen] = self._judged(nominal, seen)
        return self._known[seen]

    def _judged(self, nominal: Scene, scene: Scene) -> Rejection | None:
        own = replace(nominal, start=scene.start)
        try:
            setting = self._environments.of(scene)
            setting.begin(scene)
            if scene.start.state not in self._own:
                usual = self._environments.of(own)
                found = {kind_of(defect) for defect in _defects(usual, own)}
                self._own[scene.start.state] = found, _shown(usual, own)
        except SceneError as error:
            return Rejection("semantic", error.message)
        return None if scene == own else self._compared(setting, scene)

    def _compared(self, setting: Setting, scene: Scene) -> Rejection | None:
        """What a scene has of defects that the initial state does not have."""
        known, usual = self._own[scene.start.state]
        for thing, away in room_of(scene.task).out_of_reach(scene).items():
            name = scene.targets[thing].object
            reason = f"{name} is {away:.2f} m from the robot, which reaches {LIBERO.reach:g} m"
            return Rejection("geometry", reason)
        for defect in _defects(setting, scene):
            if kind_of(defect) not in known:
                return Rejection(CHECKS[defect.check], defect.reason)
        for placed, share, before in zip(scene.targets, _shown(setting, scene), usual, strict=False):
            if share < UNSEEN * before:
                reason = f"the camera shows {share:.0%} of {placed.object}, usually {before:.0%}"
                return Rejection("unseen", reason)
        return None


def _defects(setting: Setting, scene: Scene) -> list[Defect]:
    begin = partial(setting.begin, scene)
    return list(defects(setting.env, scene.start.state, begin, regions=False))


def _shown(setting: Setting, scene: Scene) -> list[float]:
    """The share of the surface of each thing that the task is about that the camera shows."""
    setting.begin(scene)
    env = setting.env
    return [_share(env, name) for name in env.task.things[: env.task.concerned]]


def _unknown(nominal: Scene, scene: Scene) -> str | None:
    """What a scene has and LIBERO's scenes do not; nothing of a scene may be ignored."""
    for part in ("backdrop", "frame", "then"):
        if getattr(scene, part) != getattr(nominal, part):
            return f"{part}: scenes of {nominal.task} have none of their own"
    if not all(one == Placement(one.object, REST, one.x, one.y, one.yaw) for one in scene.placements):
        return "things: LIBERO's have one size, and rest as LIBERO places them"
    return f"light: an intensity of {scene.light.intensity:g}" if scene.light.intensity < 0 else None


def kind_of(defect: Defect) -> tuple[str, str]:
    """What is wrong with what, without the amount."""
    return defect.check, defect.reason.split(" by ")[0]


def _share(env: LiberoEnv, name: str) -> float:
    """The share of a thing's surface that is in the picture, with nothing before it."""
    root = env.bodies[name]
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
