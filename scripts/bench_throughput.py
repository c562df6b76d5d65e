#!/usr/bin/env python3
"""Physics-only rollouts of the expert per second on one core.

These loops alternate scene by scene, so that other load on the machine affects all of them alike:

stock        the stock Panda with all its meshes, ``pd_ee_delta_pose``, ``is_grasping`` at every step, and
             ``gym.make``, ``reset`` and ``close`` for every scene. It follows the TCP positions and gripper commands of
             the expert's rollout in the same scene, without rendering.
ours         ``ManiSkillEvaluator`` with the expert: without and with the validity checks, and without them in a scene
             with two events that change nothing which is timed.
bare PhysX   the same objects and robot with the drive targets of our rollout; only physics steps are timed.
             It must end in the same state as ours.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before the first import of NumPy and torch

import argparse
import gc
import json
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import count
from typing import Any
from unittest.mock import patch

import gymnasium
import numpy as np
import sapien
import torch
from mani_skill.envs.sapien_env import BaseEnv
from mani_skill.utils.registration import register_env
from mani_skill.utils.structs.types import SimConfig
from numpy.typing import NDArray

from vlafuzz.model import Conditions, Monitor, Scene, Verdict
from vlafuzz.model.scene import LightSwitch, PictureLoss
from vlafuzz.worlds.manipulation.rigs import PANDA
from vlafuzz.worlds.tabletop.experts.expert import Expert
from vlafuzz.worlds.tabletop.objects.catalogue import Catalogue, load_catalogue
from vlafuzz.worlds.tabletop.sim.env import ManiSkillEvaluator, TabletopEnv
from vlafuzz.worlds.tabletop.sim.robots import MetricArm
from vlafuzz.worlds.tabletop.sim.world import SIM_HZ, World
from vlafuzz.worlds.tabletop.space import SearchSpace, load_operators
from vlafuzz.worlds.tabletop.tasks import TASKS, State

STOCK_ID = "VlaFuzzBenchStock-v1"
HZ = Expert().spec.action.hz
STOCK, OURS, CHECKED, BARE = "stock", "ours", "ours, with validity", "bare PhysX"
EVENTFUL = "ours, with events"
FASTER_THAN_STOCK, SLOWER_THAN_BARE = 5.0, 1.3  # the goals
PARTS: dict[str, tuple[type, str]] = {
    "PhysX": (World, "step"),
    "inverse kinematics": (MetricArm, "command"),
    "contacts": (World, "_contacts"),
    "state": (World, "_read"),
    "stages": (Monitor, "observe"),
    "expert": (Expert, "act"),
    "reset": (TabletopEnv, "begin"),
    "validity": (ManiSkillEvaluator, "check"),
    "rest": (ManiSkillEvaluator, "evaluate"),
}


@dataclass(frozen=True, eq=False)
class Course:
    """A rollout of the expert for the other loops to follow, with one item per control step."""

    scene: Scene
    waypoints: list[NDArray[np.float64]] = field(default_factory=list)  # (3,) TCP, metres
    gripper: list[float] = field(default_factory=list)
    drives: list[list[float]] = field(default_factory=list)  # targets of the joints
    ends: list[NDArray[np.float32]] = field(default_factory=list)  # joint positions


@register_env(STOCK_ID, override=True)
class StockEnv(BaseEnv):  # type: ignore[misc]
    """A table with objects, written as in ManiSkill's documentation."""

    SUPPORTED_ROBOTS = ("panda",)

    def __init__(self, scene: Scene, catalogue: Catalogue, **kwargs: Any) -> None:
        self._scene, self._catalogue = scene, catalogue
        super().__init__(robot_uids="panda", **kwargs)

    @property
    def _default_sim_config(self) -> SimConfig:
        return SimConfig(sim_freq=SIM_HZ, control_freq=HZ)

    def _load_agent(self, options: dict[str, Any]) -> None:
        super()._load_agent(options, sapien.Pose(PANDA.base))

    def _load_scene(self, options: dict[str, Any]) -> None:
        builder = self.scene.create_actor_builder()
        builder.add_box_collision(half_size=PANDA.table.half)
        builder.add_box_visual(half_size=PANDA.table.half)
        builder.initial_pose = sapien.Pose([*PANDA.table.centre, -PANDA.table.half[2]])
        builder.build_static("table")
        self._objects = []
        for index, placement in enumerate(self._scene.placements):
            model = self._catalogue[placement.object]
            builder = self.scene.create_actor_builder()
            material = sapien.physx.PhysxMaterial(model.friction, model.friction, 0.0)
            for file in model.collision:
                builder.add_convex_collision_from_file(str(file), material=material, density=model.density)
            builder.add_visual_from_file(str(model.visual))
            builder.initial_pose = World.place(model, placement)
            self._objects.append(builder.build(f"{index}-{placement.object}"))

    def _initialize_episode(self, env_idx: torch.Tensor, options: dict[str, Any]) -> None:
        self.agent.reset(np.array(PANDA.rest))

    def evaluate(self) -> dict[str, Any]:
        return {"grasped": self.agent.is_grasping(self._objects[0])}


class Loops:
    """All loops for one task. A loop takes a course and returns the function to time."""

    def __init__(self, task: str, scenes: int, seed: int) -> None:
        catalogue = load_catalogue()
        space = SearchSpace(load_operators(), catalogue, task)
        apart = space.operators.min_distance
        self._ours = ManiSkillEvaluator(
            Conditions(task=task, world={"min_distance": apart}), Expert(), catalogue, checked=False
        )
        self._checked = ManiSkillEvaluator(Conditions(task=task, world={"min_distance": apart}), Expert(), catalogue)
        drawn = (space.sample(np.random.default_rng([seed, index])) for index in count())
        recorded = filter(None, map(self._record, drawn))
        self.courses = [next(recorded) for _ in range(scenes)]
        self._catalogue, self.renderer = catalogue, ""
        self.grasped: set[str] = set()
        self.by_name: dict[str, Callable[[Course], Callable[[], object]]] = {
            STOCK: self._play_stock,
            OURS: partial(self._play_ours, self._ours),
            CHECKED: partial(self._play_ours, self._checked),
            EVENTFUL: self._play_events,
            BARE: self._play_bare,
        }

    def _play_ours(self, evaluator: ManiSkillEvaluator, course: Course) -> Callable[[], object]:
        gc.collect()
        gc.freeze()  # as in a process that only has this evaluator
        return lambda: evaluator.evaluate([course.scene])

    def _play_events(self, course: Course) -> Callable[[], object]:
        events: Any = {"picture_loss": PictureLoss("carry", 5), "light_switch": LightSwitch("carry", 2.0)}
        return self._play_ours(self._ours, replace(course, scene=replace(course.scene, **events)))

    def _play_stock(self, course: Course) -> Callable[[], None]:
        gc.unfreeze()  # stock does not freeze

        def run() -> None:
            env = self._make_stock(course.scene)
            env.reset()
            action = np.zeros(7, dtype=np.float32)
            for waypoint, gripper in zip(course.waypoints, course.gripper, strict=True):
                action[:3] = np.clip((waypoint - env.agent.tcp.pose.p[0].numpy()) / 0.1, -1, 1)
                action[6] = gripper
                if env.step(action)[-1]["grasped"]:
                    self.grasped.add(course.scene.digest)
            env.close()

        return run

    def _make_stock(self, scene: Scene) -> Any:
        lean: Any = {"obs_mode": "none", "reward_mode": "none", "control_mode": "pd_ee_delta_pose"}
        env: Any = gymnasium.make(STOCK_ID, scene=scene, catalogue=self._catalogue, **lean).unwrapped
        self.renderer = str(env.backend.render_backend)
        return env

    def _play_bare(self, course: Course) -> Callable[[], None]:
        self._env.begin(course.scene)
        robot, system = self._env.agent.robot._objs[0], self._env.world.scene.physx_system

        def run() -> None:
            for targets in course.drives:
                for joint, target in zip(robot.active_joints, targets, strict=True):
                    joint.set_drive_target(target)
                for _ in range(SIM_HZ // HZ):
                    system.step()
            assert np.array_equal(robot.qpos, course.ends[-1]), "bare PhysX ended in another state than ours"

        return run

    def _record(self, scene: Scene) -> Course | None:
        course, advance = Course(scene), TabletopEnv.advance

        def recording(env: TabletopEnv, action: NDArray[np.float64], relative_to: str) -> State:
            state = advance(env, action, relative_to)
            robot = env.agent.robot._objs[0]
            course.waypoints.append(state.tcp)
            course.gripper.append(float(action[6]))
            course.drives.append([float(joint.drive_target[0]) for joint in robot.active_joints])
            course.ends.append(robot.qpos)
            self._env = env
            return state

        with patch.object(TabletopEnv, "advance", recording):
            outcome = self._checked.evaluate([scene])[0]
        if outcome.verdict is Verdict.ERROR:
            raise RuntimeError(outcome.detail)
        return None if outcome.verdict is Verdict.INVALID else course


def measure(loops: Loops, repetitions: int) -> dict[str, list[float]]:
    """Wall and CPU seconds of each loop: medians over a scene's repetitions, summed over the scenes."""
    shuffle = np.random.default_rng(0).permutation
    spent = {name: np.zeros((1 + repetitions, len(loops.courses), 2)) for name in loops.by_name}
    for repetition in range(1 + repetitions):
        for index, course in enumerate(loops.courses):
            for name in shuffle(list(loops.by_name)).tolist():  # so that no loop always follows the same one
                run = loops.by_name[name](course)
                wall, cpu = time.perf_counter(), time.process_time()
                run()
                spent[name][repetition, index] = time.perf_counter() - wall, time.process_time() - cpu
    # the first repetition warms up
    return {name: np.median(times[1:], axis=0).sum(axis=0).tolist() for name, times in spent.items()}


def breakdown(loops: Loops) -> dict[str, float]:
    """CPU seconds of the checked evaluator by part over all scenes, without those of nested parts."""
    spent, inner = dict.fromkeys(PARTS, 0.0), [0.0]

    def timed(part: str, function: Callable[..., object]) -> Callable[..., object]:
        def call(*args: Any, **kwargs: Any) -> object:
            inner.append(0.0)
            began = time.process_time()
            try:
                return function(*args, **kwargs)
            finally:
                whole = time.process_time() - began
                spent[part] += whole - inner.pop()
                inner[-1] += whole

        return call

    with ExitStack() as patches:
        for part, (owner, name) in PARTS.items():
            patches.enter_context(patch.object(owner, name, timed(part, getattr(owner, name))))
        for course in loops.courses:
            loops.by_name[CHECKED](course)()
    return spent


def summarise(loops: Loops, repetitions: int) -> dict[str, Any]:
    """The printed report. Ratios are of CPU time."""
    rollouts, steps = len(loops.courses), sum(len(course.drives) for course in loops.courses)
    spent = measure(loops, repetitions)
    rows = {
        name: {
            "rollouts_per_second": rollouts / wall,
            "wall_ms_per_rollout": 1e3 * wall / rollouts,
            "cpu_ms_per_rollout": 1e3 * cpu / rollouts,
            "cpu_ms_per_step": 1e3 * cpu / steps,
            "times_stock": spent[STOCK][1] / cpu,
            "times_bare": cpu / spent[BARE][1],
        }
        for name, (wall, cpu) in spent.items()
    }
    ours = rows[OURS]
    return {
        "rollouts": rollouts,
        "steps": steps,
        "repetitions": repetitions,
        "stock_renderer": loops.renderer,
        "stock_grasped": len(loops.grasped),
        "loops": rows,
        "cpu_ms_per_step_in": {part: 1e3 * seconds / steps for part, seconds in breakdown(loops).items()},
        "goals_reached": ours["times_stock"] >= FASTER_THAN_STOCK and ours["times_bare"] <= SLOWER_THAN_BARE,
    }


def show(task: str, report: dict[str, Any]) -> None:
    size = f"{report['rollouts']} scenes, {report['steps']} control steps of {SIM_HZ // HZ} physics steps"
    print(f"{task}: {size}, medians of {report['repetitions']} repetitions, one thread")
    print(f"stock's renderer is {report['stock_renderer']}; it grasped in {report['stock_grasped']} scenes\n")
    print(f"{'':20} rollouts/s  ms/rollout  CPU ms/rollout  CPU ms/step  x stock's speed  x bare's time")
    for name, row in report["loops"].items():
        values = zip(row.values(), ("11.1f", "12.1f", "16.1f", "13.2f", "17.1f", "15.2f"), strict=True)
        print(f"{name:20}" + "".join(format(*value) for value in values))
    parts = report["cpu_ms_per_step_in"]
    print(f"\n{CHECKED:20} CPU ms/step  share")
    for part, spent in parts.items():
        print(f"{part:20}{spent:12.3f}{spent / sum(parts.values()):7.1%}")
    goals = f"{FASTER_THAN_STOCK:g} times stock's speed, at most {SLOWER_THAN_BARE:g} times bare PhysX's time"
    print(f"\ngoals: {goals}: {'reached' if report['goals_reached'] else 'MISSED'}\n", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--task", choices=[*TASKS, "all"], default="pick-up")
    parser.add_argument("--scenes", type=int, default=16, help="number of scenes")
    parser.add_argument("--repetitions", type=int, default=5)
    parser.add_argument("--seed", type=int, default=0, help="of the scenes")
    parser.add_argument("--json", action="store_true", help="print one JSON object instead")
    options = parser.parse_args()
    torch.set_num_threads(1)
    reports = {}
    for task in TASKS if options.task == "all" else [options.task]:
        loops = Loops(task, options.scenes, options.seed)
        reports[task] = summarise(loops, options.repetitions)
        if not options.json:
            show(task, reports[task])
    if options.json:
        print(json.dumps(reports, indent=2))


if __name__ == "__main__":
    main()
