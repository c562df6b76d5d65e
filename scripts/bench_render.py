#!/usr/bin/env python3
"""The cost of an image, the effect of simplified rendering, and rendered rollouts of `mini` per hour.

Three variants of rendering alternate, image by image, each in a process of its own (SAPIEN keeps shaders globally).
Scenes, room, lights, camera and joint positions are the same:

ours           the simplified robot, and SAPIEN's `minimal` shaders without their reflectance table
stock          the Panda's full meshes and `minimal` as it comes, ManiSkill's default
stock default  the full meshes and SAPIEN's `default` shaders

An image takes `update_render`, `take_picture` and `get_picture` after the robot has moved. Similarity is the structural
similarity (SSIM, Wang et al. 2004) to stock's image. Start-up is from a fresh process to its first image, including
imports, with warm caches. `--rollouts` measures whole rollouts instead: nominal light and camera, one target, all
checks, ten steps after success, as campaigns run them.
"""

from __future__ import annotations

import os

# before the first import of NumPy and torch, and the first Vulkan call; worker processes inherit them
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("LP_NUM_THREADS", "0")

import argparse
import json
import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from functools import cache
from itertools import count
from multiprocessing import get_context
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import torch
from mani_skill.agents.robots.panda import Panda
from mani_skill.render.shaders import PREBUILT_SHADER_CONFIGS, ShaderConfig, set_shader_pack
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from tests.worlds.similarity import similarity
from vlafuzz.model import Conditions, Scene, Verdict
from vlafuzz.policies.base import CameraRequest
from vlafuzz.policies.mini.policy import Mini
from vlafuzz.worlds.tabletop.fairness import check_static
from vlafuzz.worlds.tabletop.objects.catalogue import load_catalogue
from vlafuzz.worlds.tabletop.sim import rendering, robots, world
from vlafuzz.worlds.tabletop.sim.env import ManiSkillEvaluator, TabletopEnv
from vlafuzz.worlds.tabletop.space import SearchSpace, load_operators
from vlafuzz.worlds.tabletop.tasks import TASKS

OURS, STOCK, DEFAULT = "ours", "stock", "stock default"
PACKS = {STOCK: "minimal", DEFAULT: "default"}
VARIANTS = (OURS, *PACKS)
TARGETS = ("target-type", "target-position", "target-orientation")
CLUTTER = (*TARGETS, "confounder-type", "confounder-position", "confounder-orientation", "confounder-count")
FASTER, SIMILAR, READY, PER_HOUR = 5.0, 0.95, 4.0, 15_000  # the goals; seconds, rollouts
PARTS: dict[str, tuple[type, str]] = {
    "physics": (world.World, "step"),
    "picture": (TabletopEnv, "picture"),
    "model": (Mini, "act"),
    "reset": (TabletopEnv, "begin"),
    "validity": (ManiSkillEvaluator, "check"),
    "rest": (ManiSkillEvaluator, "evaluate"),
}
Picture = NDArray[np.uint8]
_together: Any = None  # in a worker: the barrier at which all workers start


@dataclass(frozen=True, eq=False)
class Shot:
    """One image, and the seconds that it took."""

    wall: float
    cpu: float
    picture: Picture


def scenes_of(task: str, vary: Sequence[str], number: int, seed: int) -> list[Scene]:
    """Generated scenes that pass the static checks, with all other operators nominal."""
    operators, catalogue = load_operators(), load_catalogue()
    space = SearchSpace(operators.only(vary), catalogue, task)
    drawn = (space.sample(np.random.default_rng([seed, index, *task.encode()])) for index in count())
    fair = (scene for scene in drawn if check_static(scene, catalogue, operators.min_distance) is None)
    return [next(fair) for _ in range(number)]


# images: in the worker processes


@cache
def environment(variant: str, task: str, size: int) -> TabletopEnv:
    """An environment with one variant of rendering; the process is bound to it."""
    if variant in PACKS:
        _render_as_stock(PACKS[variant])
    cameras = (CameraRequest("front", size, size),)
    return TabletopEnv(task, load_catalogue(), cameras)


def _render_as_stock(pack: str) -> None:
    def use_stock() -> ShaderConfig:
        set_shader_pack(PREBUILT_SHADER_CONFIGS[pack])
        return PREBUILT_SHADER_CONFIGS[pack]

    for module in (rendering, world):
        patch.object(module, "use_shaders", use_stock).start()
    patch.object(robots.MetricPanda, "urdf_path", Panda.urdf_path).start()


def shoot(variant: str, scene: Scene, size: int, moves: int) -> list[Shot]:
    """The images of a scene after each move of the robot, without the first one (warm-up)."""
    env = environment(variant, scene.task, size)
    env.begin(scene)
    rng, robot = np.random.default_rng(int(scene.digest[:8], 16)), env.agent.robot._objs[0]
    rest, shots = robot.qpos, []
    for _ in range(1 + moves):
        robot.qpos = rest + rng.normal(0.0, 0.1, rest.shape).astype(np.float32)
        wall, cpu = time.perf_counter(), time.process_time()
        picture = env.picture("front")
        shots.append(Shot(time.perf_counter() - wall, time.process_time() - cpu, picture))
    return shots[1:]


def first_picture(variant: str, scene: Scene, size: int) -> float:
    """CPU seconds of this process until its first image."""
    env = environment(variant, scene.task, size)
    env.begin(scene)
    assert env.picture("front").any()
    return time.process_time()


def fresh_process() -> ProcessPoolExecutor:
    return ProcessPoolExecutor(1, get_context("spawn"))


# images: evaluation


def measure(scenes: Sequence[Scene], size: int, moves: int) -> dict[str, list[Shot]]:
    """All images of each variant; the variants alternate per scene, in random order."""
    shuffle = np.random.default_rng(0).permutation
    shots: dict[str, list[Shot]] = {variant: [] for variant in VARIANTS}
    workers = {variant: fresh_process() for variant in VARIANTS}
    for scene in scenes:
        for variant in shuffle(VARIANTS).tolist():
            shots[variant] += workers[variant].submit(shoot, variant, scene, size, moves).result()
    for worker in workers.values():
        worker.shutdown()
    return shots


def start_up(variant: str, scene: Scene, size: int, repetitions: int) -> tuple[float, float]:
    """Seconds from the start of a process to its first image, wall and CPU: medians of fresh processes."""
    spent = []
    for _ in range(repetitions):
        began = time.perf_counter()
        with fresh_process() as worker:
            cpu = worker.submit(first_picture, variant, scene, size).result()
            spent.append((time.perf_counter() - began, cpu))
    wall, cpu = np.median(spent, axis=0).tolist()
    return wall, cpu


def summarise_pictures(options: argparse.Namespace) -> dict[str, Any]:
    """The printed report. Times are medians; similarity has mean and minimum."""
    scenes = [scene for task in TASKS for scene in scenes_of(task, CLUTTER, options.scenes, options.seed)]
    shots = measure(scenes, options.size, options.moves)
    rows: dict[str, dict[str, float]] = {}
    for variant in VARIANTS:
        wall, cpu = np.median([(shot.wall, shot.cpu) for shot in shots[variant]], axis=0).tolist()
        alike = [similarity(a.picture, b.picture) for a, b in zip(shots[variant], shots[STOCK], strict=True)]
        ready, ready_cpu = start_up(variant, scenes[0], options.size, options.repetitions)
        rows[variant] = {
            "wall_ms": 1e3 * wall,
            "cpu_ms": 1e3 * cpu,
            "similarity": float(np.mean(alike)),
            "least_similarity": min(alike),
            "start_up_seconds": ready,
            "start_up_cpu_seconds": ready_cpu,
        }
    ours = rows[OURS]
    for row in rows.values():
        row["times_ours"] = row["wall_ms"] / ours["wall_ms"]
    reached = {
        "faster": rows[STOCK]["times_ours"] >= FASTER,
        "similar": ours["similarity"] >= SIMILAR,
        "ready": ours["start_up_cpu_seconds"] <= READY,
    }
    return {"scenes": len(scenes), "pictures": len(shots[OURS]), "variants": rows, "goals_reached": reached}


def show_pictures(report: dict[str, Any], size: int) -> None:
    print(f"{report['pictures']} pictures of {size} pixels in {report['scenes']} scenes; medians\n")
    print(f"{'':14}  ms/picture  CPU ms  x ours  similarity  least  start-up s  CPU s")
    for variant, row in report["variants"].items():
        print(f"{variant:14}{row['wall_ms']:12.2f}{row['cpu_ms']:8.2f}{row['times_ours']:8.1f}", end="")
        print(f"{row['similarity']:12.3f}{row['least_similarity']:7.3f}", end="")
        print(f"{row['start_up_seconds']:12.1f}{row['start_up_cpu_seconds']:7.1f}")
    goals = f"{FASTER:g} x faster than stock, mean similarity {SIMILAR:g}, a start in {READY:g} s of CPU"
    verdict = ", ".join(f"{goal} {'yes' if met else 'NO'}" for goal, met in report["goals_reached"].items())
    print(f"\ngoals: {goals}: {verdict}", flush=True)


# rollouts


@dataclass
class Work:
    """The work of one process."""

    rollouts: int = 0
    passed: int = 0
    steps: int = 0
    seconds: float = 0.0
    cpu: float = 0.0
    spent: dict[str, float] = field(default_factory=lambda: dict.fromkeys(PARTS, 0.0))


def time_parts(spent: dict[str, float]) -> None:
    """From now on, add up the seconds of each part, without those of nested parts."""
    inner = [0.0]

    def timed(part: str, function: Callable[..., object]) -> Callable[..., object]:
        def call(*args: Any, **kwargs: Any) -> object:
            inner.append(0.0)
            began = time.perf_counter()
            try:
                return function(*args, **kwargs)
            finally:
                whole = time.perf_counter() - began
                spent[part] += whole - inner.pop()
                inner[-1] += whole

        return call

    for part, (owner, name) in PARTS.items():
        patch.object(owner, name, timed(part, getattr(owner, name))).start()


def roll_out(job: tuple[int, float, int]) -> Work:
    """Rollouts for ``seconds``, after a warm-up. All workers start the clock together."""
    worker, seconds, seed = job
    torch.set_num_threads(1)
    operators, catalogue = load_operators(), load_catalogue()
    space = SearchSpace(operators.only(TARGETS), catalogue, "pick-up")
    evaluator = ManiSkillEvaluator(
        Conditions(task="pick-up", world={"min_distance": operators.min_distance}), Mini(), catalogue
    )
    evaluator.evaluate([space.sample(np.random.default_rng([seed, worker, 0]))])
    _together.wait(300)
    work = Work()
    time_parts(work.spent)
    wall, cpu, numbers = time.perf_counter(), time.process_time(), count(1)
    while work.seconds < seconds:
        scene = space.sample(np.random.default_rng([seed, worker, next(numbers)]))
        (outcome,) = evaluator.evaluate([scene])
        if outcome.verdict is Verdict.ERROR:
            raise RuntimeError(outcome.detail)
        work.rollouts += len(outcome.rollouts)
        work.passed += outcome.verdict is Verdict.PASSED
        work.steps += sum(rollout.steps for rollout in outcome.rollouts)
        work.seconds, work.cpu = time.perf_counter() - wall, time.process_time() - cpu
    return work


def _meet_at(barrier: Any) -> None:
    global _together
    _together = barrier


def summarise_rollouts(options: argparse.Namespace) -> dict[str, Any]:
    spawn = get_context("spawn")
    barrier = spawn.Barrier(options.workers)
    with spawn.Pool(options.workers, _meet_at, (barrier,)) as pool:
        jobs = [(worker, options.seconds, options.seed) for worker in range(options.workers)]
        works = pool.map(roll_out, jobs, chunksize=1)
    rollouts, steps = sum(work.rollouts for work in works), sum(work.steps for work in works)
    per_hour = sum(3600 * work.rollouts / work.seconds for work in works)
    return {
        "workers": options.workers,
        "rollouts": rollouts,
        "passed": sum(work.passed for work in works),
        "steps_per_rollout": steps / rollouts,
        "rollouts_per_hour": per_hour,
        "rollouts_per_cpu_hour": 3600 * rollouts / sum(work.cpu for work in works),
        "ms_per_step_in": {part: 1e3 * sum(work.spent[part] for work in works) / steps for part in PARTS},
        "goal_reached": per_hour >= PER_HOUR,
    }


def show_rollouts(report: dict[str, Any]) -> None:
    print(f"{report['workers']} workers, {report['rollouts']} rollouts of pick-up, {report['passed']} passed,", end="")
    print(f" {report['steps_per_rollout']:.1f} control steps each")
    print(f"{report['rollouts_per_hour']:,.0f} rollouts an hour, goal {PER_HOUR:,}:", end=" ")
    print(f"{'reached' if report['goal_reached'] else 'MISSED'};", end=" ")
    print(f"{report['rollouts_per_cpu_hour']:,.0f} an hour of one core's time\n")
    parts = report["ms_per_step_in"]
    print(f"{'':10} ms/step  share")
    for part, spent in parts.items():
        print(f"{part:10}{spent:8.2f}{spent / sum(parts.values()):7.1%}")
    print(end="", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--size", type=int, default=128, help="pixels of an image's side")
    parser.add_argument("--scenes", type=int, default=6, help="per task")
    parser.add_argument("--moves", type=int, default=8, help="of the robot in each scene, with one image each")
    parser.add_argument("--repetitions", type=int, default=3, help="of the start-up")
    parser.add_argument("--rollouts", action="store_true", help="measure rollouts instead of images")
    parser.add_argument("--workers", type=int, default=2, help="processes for rollouts")
    parser.add_argument("--seconds", type=float, default=60.0, help="of rollouts")
    parser.add_argument("--seed", type=int, default=0, help="of the scenes")
    parser.add_argument("--json", action="store_true", help="print one JSON object instead")
    options = parser.parse_args()
    report = summarise_rollouts(options) if options.rollouts else summarise_pictures(options)
    if options.json:
        print(json.dumps(report, indent=2))
    elif options.rollouts:
        show_rollouts(report)
    else:
        show_pictures(report, options.size)


if __name__ == "__main__":
    main()
