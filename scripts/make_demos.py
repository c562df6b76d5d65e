#!/usr/bin/env python
"""Demonstrations of the expert for training `mini`: observations with the expert's actions as labels.

Scenes are generated with the operators of demos.yaml and pass all validity checks; wordings are the first few of each
task. Most episodes are disturbed (noise on the executed actions, random first steps, a gripper that slips); the label
is always the expert's action. Failed episodes are left out. Every worker writes one folder of arrays: frames (n, size,
size, 3) uint8, and the data of each step in steps.npz.

With --driver, the weights of an earlier round drive the first steps of most episodes, and the expert takes over from
there (as in DAgger, Ross et al., 2011), which shows how to recover from that policy's states. Driven steps are kept,
since the gripper's clock needs them, but not `taught`.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from disturbance import Disturbance
from mini_data import write
from numpy.typing import NDArray

from vlafuzz.model import Conditions, Scene, Verdict
from vlafuzz.policies.base import ActionChunk, CameraRequest, EpisodeStart, Observation
from vlafuzz.policies.mini.policy import Mini
from vlafuzz.worlds.manipulation.camera import camera_pose
from vlafuzz.worlds.manipulation.rigs import PANDA
from vlafuzz.worlds.tabletop.experts.expert import Expert
from vlafuzz.worlds.tabletop.objects import load_catalogue
from vlafuzz.worlds.tabletop.sim.env import ManiSkillEvaluator
from vlafuzz.worlds.tabletop.space import SearchSpace, load_operators
from vlafuzz.worlds.tabletop.tasks import TASKS, load_wordings, say

SIZE = 128
WORDINGS = 4  # of each task; the others stay unseen
NOMINAL = 0.5  # share of episodes with the first wording
SEEDS = 10**6  # demonstrations have seeds from here on; smaller ones are for tests


class Demonstrator:
    """The expert with disturbed actions; records its observations and undisturbed actions."""

    def __init__(self, driver: Path | None = None) -> None:
        self._expert = Expert(fluent=True)
        self._driver = Mini(driver) if driver else None
        front = CameraRequest("front", SIZE, SIZE)
        self.spec = replace(self._expert.spec, cameras=(front,), state=True)
        self._expert.spec = self.spec
        self.steps: list[dict[str, Any]] = []

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        (start,) = episodes
        self.steps = []
        self._expert.reset(episodes)
        self._disturbance = Disturbance(start.seed, driven=self._driver is not None)
        if self._driver:
            self._driver.reset(episodes)

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        (seen,) = observations
        driven = self._disturbance.is_driven(seen.step)
        (chunk,) = (self._driver if driven and self._driver else self._expert).act(observations)
        label = chunk.actions[0]
        executed = label if driven else self._disturbance.executed(seen.step, label, _away(seen))
        self.steps.append(_note(seen, label) | {"gripper": executed[6], "taught": not driven})
        return [ActionChunk(executed[None])]

    def close(self) -> None:
        self._expert.close()


def _away(seen: Observation) -> float:
    """Metres from the hand to the first object."""
    assert seen.privileged is not None
    state = seen.privileged.state
    return float(np.linalg.norm(state.positions[0] - state.tcp))


def _note(seen: Observation, label: NDArray[np.float64]) -> dict[str, Any]:
    known = seen.privileged
    assert known is not None
    targets = TASKS[known.scene.task].targets
    places = np.zeros((2, 3))
    places[:targets] = known.state.positions[:targets]
    points = np.concatenate([places, known.state.tcp[None]])
    pixels, _ = camera_pose(PANDA.view, known.scene.camera).project(points)
    return {
        "frame": seen.images["front"],
        "state": seen.state,
        "label": label,
        "places": places,
        "pixels": pixels,
        "targets": targets,
        "text": known.scene.instruction,
    }


@dataclass(frozen=True)
class Job:
    """The work of one process."""

    task: str
    number: int
    first: int
    count: int
    seconds: float
    driver: Path | None
    events: Sequence[str]
    out: Path

    def run(self) -> dict[str, Any]:
        os.environ.update({"OMP_NUM_THREADS": "1", "LP_NUM_THREADS": "0"})
        began = time.monotonic()
        operators = load_operators(str(Path(__file__).with_name("demos.yaml")))
        space = SearchSpace(operators.only([*operators.varied, *self.events]), load_catalogue(), self.task)
        steps: list[dict[str, Any]] = []
        tried = kept = 0
        demonstrator = Demonstrator(self.driver)
        evaluator = ManiSkillEvaluator(
            Conditions(task=self.task, world={"min_distance": space.operators.min_distance}, stop_early=True),
            demonstrator,
            space.catalogue,
        )
        for seed in range(SEEDS + self.first, SEEDS + self.first + self.count):
            if time.monotonic() - began > self.seconds:
                break
            evaluator.seed = seed
            rng = np.random.default_rng([seed, *self.task.encode()])
            scene = space.sample(rng)
            while self.events and not scene.events:
                scene = space.sample(rng)
            scene = worded(scene, space, seed)
            (outcome,) = evaluator.evaluate([scene])
            tried += outcome.verdict >= Verdict.PASSED
            if outcome.verdict is Verdict.PASSED and any(step["taught"] for step in demonstrator.steps):
                kept += 1
                steps += [step | {"episode": seed} for step in demonstrator.steps]
        write(steps, self.out / f"{self.task}-{self.number:02d}")
        return {"task": self.task, "tried": tried, "kept": kept, "frames": len(steps)}


def worded(scene: Scene, space: SearchSpace, seed: int) -> Scene:
    """The scene with one of the wordings for training."""
    rng = np.random.default_rng([seed, 2])
    number = 0 if rng.random() < NOMINAL else int(rng.integers(1, WORDINGS))
    spoken = [space.catalogue[target.object].spoken for target in scene.targets]
    return replace(scene, instruction=say(load_wordings()[scene.task][number], spoken))


def main() -> None:
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    parser.add_argument("--episodes", type=int, nargs=4, default=[4500, 4500, 5500, 5500], metavar="N", help="per task")
    parser.add_argument("--workers", type=int, nargs=4, default=[1, 1, 1, 1], metavar="N", help="per task")
    parser.add_argument("--seconds", type=float, default=1e9, help="time limit per job")
    parser.add_argument("--first", type=int, default=0, help="number of the first episode")
    parser.add_argument("--driver", type=Path, help="folder of weights that drive the first steps")
    parser.add_argument("--events", nargs="*", default=[], help="operators of which each scene has an event")
    parser.add_argument("--out", type=Path, required=True, help="folder")
    options = parser.parse_args()
    began = time.monotonic()
    jobs = [
        Job(
            task,
            number,
            options.first + number * (count // workers),
            count // workers,
            options.seconds,
            options.driver,
            options.events,
            options.out,
        )
        for task, count, workers in zip(TASKS, options.episodes, options.workers, strict=True)
        for number in range(workers)
    ]
    with get_context("spawn").Pool(sum(options.workers), maxtasksperchild=1) as pool:
        for done in pool.imap_unordered(Job.run, jobs):
            print(json.dumps(done | {"seconds": round(time.monotonic() - began)}), flush=True)


if __name__ == "__main__":
    main()
