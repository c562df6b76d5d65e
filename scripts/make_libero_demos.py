#!/usr/bin/env python
"""Demonstrations of LIBERO's expert for training `mini` with train_mini.py.

Scenes are near the suites' own initial states, of which the first ten are left out for tests. Most episodes are
disturbed as by make_demos.py, also by a --driver; the label is always the expert's action. Failed episodes are left
out. Needs scripts/setup-libero.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from disturbance import Disturbance
from mini_data import ABOUT, write
from numpy.typing import NDArray

from vlafuzz.model import Conditions, Scene, Verdict
from vlafuzz.model.scene import Start
from vlafuzz.policies.base import ActionChunk, ActionSpec, EpisodeStart, Observation, PolicySpec
from vlafuzz.policies.mini.policy import CAMERA, WRIST, Mini
from vlafuzz.worlds.libero.env import HZ, UNITS, LiberoEnv
from vlafuzz.worlds.libero.evaluator import LiberoEvaluator
from vlafuzz.worlds.libero.expert import Expert
from vlafuzz.worlds.libero.pictures import CAMERAS, QUALITY
from vlafuzz.worlds.libero.space import LiberoSpace, nominal_scene
from vlafuzz.worlds.libero.stages import held
from vlafuzz.worlds.tabletop.space import load_operators

Array = NDArray[np.float64]
SCALE = 2.0  # metres and radians a unit: the controller covers a quarter of what is asked for
ACTION = ActionSpec(relative_to="current", position_scale=SCALE, rotation_scale=SCALE)
PACE = HZ // ACTION.hz
FARTHEST = np.array([0.1] * 3 + [0.6] * 3)
TESTED = 10  # the first initial states of each task, never shown
NOMINAL = 0.3  # share of episodes that begin in an initial state itself
ROBOT, QUALITIES = "libero", QUALITY.options  # of pictures, in turn
SEEDS = 10**6
CARD = {
    "name": "mini-libero",
    "note": "A demonstration policy, trained by us in LIBERO with little randomisation. "
    "It is not evidence about OpenVLA, pi0 or any other model.",
    "views": 2,
    "action": {"position_scale": SCALE, "rotation_scale": SCALE},
}


class Demonstrator:
    """The expert, five actions a second, with disturbances; records observations and undisturbed actions."""

    def __init__(self, driver: Path | None = None) -> None:
        self._driver = Mini(driver) if driver else None
        self.spec = PolicySpec(
            "demonstrator", action=ACTION, cameras=(CAMERA, WRIST), state=True, privileged=True, execute=1
        )
        self.steps: list[dict[str, Any]] = []
        self._plan: Iterator[Array] | None = None

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        (start,) = episodes
        self.steps, self._plan, self._held = [], None, False
        self._disturbance = Disturbance(start.seed, driven=self._driver is not None)
        if self._driver:
            self._driver.reset(episodes)

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        (seen,) = observations
        known: Any = seen.privileged
        if self._driver and self._disturbance.is_driven(seen.step):
            label = self._driver.act(observations)[0].actions[0]
            executed, taught = label, False
        else:
            label, taught = self._label(known), True
            thing, _, hand = _points(known)
            executed = self._disturbance.executed(seen.step, label, float(np.linalg.norm(thing - hand)))
        note = _note(seen, known, label)
        self.steps.append(note | {"gripper": executed[6], "taught": taught})
        return [ActionChunk(executed[None])]

    def close(self) -> None:
        if self._driver:
            self._driver.close()

    def _label(self, env: LiberoEnv) -> Array:
        """The expert's next action. It plans again when its plan is over, or has lost what it carried."""
        now = held(env, env.task.carried[0])
        lost = self._held and not now and bool(self.steps) and self.steps[-1]["gripper"] < 0
        self._held = now
        for _ in range(2):
            if self._plan is None or lost:
                self._plan, lost = _plan(env), False
            if (action := next(self._plan, None)) is not None:
                metric = action * UNITS
                metric[:6] = np.clip(metric[:6] * PACE / SCALE, -FARTHEST, FARTHEST)
                return np.asarray(metric)
            self._plan = None
        return np.array([0.0] * 6 + [1.0])


def _plan(env: LiberoEnv) -> Iterator[Array]:
    return Expert(env, pace=PACE, tries=1).actions()


def _points(env: LiberoEnv) -> Array:
    """``(3, 3)``: what is to be carried, where to, and the hand; metres."""
    bodies = env.robosuite.obj_body_id
    _, thing, goal = next(atom for atom in env.task.goal if len(atom) == 3)
    place = env.data.xpos[bodies[goal]] if goal in bodies else env.data.site(goal).xpos
    return np.stack([env.data.xpos[bodies[thing]], place, env.data.site_xpos[env.robosuite.robots[0].eef_site_id]])


def _projected(env: LiberoEnv, points: Array) -> Array:
    """``(n, 2)`` places in the third-person picture, from its upper left corner, in shares of its side."""
    camera = env.model.camera(CAMERAS[0]).id
    away = (points - env.data.cam_xpos[camera]) @ env.data.cam_xmat[camera].reshape(3, 3)
    half = np.tan(np.radians(env.model.cam_fovy[camera]) / 2)
    right, up = (away[:, :2] / -away[:, 2:] / half).T
    return np.stack([(1 - right) / 2, (1 - up) / 2], axis=1)  # policies get it mirrored


def _note(seen: Observation, env: LiberoEnv, label: Array) -> dict[str, Any]:
    points = _points(env)
    return {
        "frame": np.concatenate([seen.images[camera.name] for camera in (CAMERA, WRIST)], axis=2),
        "state": seen.state,
        "label": label,
        "places": points[:2],
        "pixels": _projected(env, points),
        "targets": 2,
        "text": seen.instruction,
    }


@dataclass(frozen=True)
class Job:
    """The work of one process: episodes of one task."""

    task: str
    first: int
    count: int
    driver: Path | None
    events: Sequence[str]
    out: Path

    @property
    def quality(self) -> str:
        """The quality of the pictures that are seen."""
        return QUALITIES[self.first // self.count % len(QUALITIES)]

    def run(self) -> dict[str, Any]:
        os.environ.update({"OMP_NUM_THREADS": "1", "LP_NUM_THREADS": "0"})
        operators = load_operators(str(Path(__file__).with_name("demos-libero.yaml")))
        space = LiberoSpace(operators.only([*operators.varied, *self.events]), self.task, ROBOT)
        steps: list[dict[str, Any]] = []
        tried = kept = 0
        demonstrator = Demonstrator(self.driver)
        conditions = Conditions(task=self.task, robot=ROBOT, world={QUALITY.name: self.quality}, stop_early=True)
        evaluator = LiberoEvaluator(conditions, demonstrator, checked=False)
        for seed in range(SEEDS + self.first, SEEDS + self.first + self.count):
            evaluator.seed = seed
            (outcome,) = evaluator.evaluate([drawn(space, seed, events=bool(self.events))])
            tried += outcome.verdict >= Verdict.PASSED
            if outcome.verdict is Verdict.PASSED and any(step["taught"] for step in demonstrator.steps):
                kept += 1
                steps += [step | {"episode": seed} for step in demonstrator.steps]
        evaluator.renew()
        if steps:
            write(steps, self.out / f"{self.task.replace('/', '-')}-{self.first:06d}")
        return {"task": self.task, "tried": tried, "kept": kept, "frames": len(steps)}


def drawn(space: LiberoSpace, seed: int, *, events: bool) -> Scene:
    """A scene near one of the initial states that are shown, with an event if wanted."""
    rng = np.random.default_rng([seed, *space.task.name.encode()])
    scene = space.sample(rng) if events or rng.random() >= NOMINAL else nominal_scene(space.task.name, space.rig.robot)
    while events and not scene.events:
        scene = space.sample(rng)
    last = space.rig.initial_states
    return replace(scene, start=Start(int(rng.integers(TESTED, last))))


def main() -> None:
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    parser.add_argument("tasks", nargs="+", help="SUITE/NUMBER")
    parser.add_argument("--episodes", type=int, default=400, help="of each task")
    parser.add_argument("--batch", type=int, default=50, help="episodes of one process")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--first", type=int, default=0, help="number of the first episode")
    parser.add_argument("--driver", type=Path, help="folder of weights that drive the first steps")
    parser.add_argument("--events", nargs="*", default=[], help="operators of which each scene has an event")
    parser.add_argument("--out", type=Path, required=True, help="folder")
    options = parser.parse_args()
    began = time.monotonic()
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / ABOUT).write_text(json.dumps(CARD))
    jobs = [
        Job(
            task,
            options.first + number,
            min(options.batch, options.episodes - number),
            options.driver,
            options.events,
            options.out,
        )
        for number in range(0, options.episodes, options.batch)
        for task in options.tasks
    ]
    with get_context("spawn").Pool(options.workers, maxtasksperchild=1) as pool:
        for done in pool.imap_unordered(Job.run, jobs):
            print(json.dumps(done | {"seconds": round(time.monotonic() - began)}), flush=True)


if __name__ == "__main__":
    main()
