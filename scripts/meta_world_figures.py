#!/usr/bin/env python
"""What vlafuzz finds in Meta-World, and what it costs there.

``faults``: the scripted policy with a planted fault stands still from the start wherever one parameter of the scene is
beyond a threshold. After a run and its triage, is there a certified cause whose minimal scene differs from the nominal
one in exactly that parameter, with a threshold within a step of its grid? ``weak``: the causes of the scripted policy
that acts on what it saw 50 ms ago. ``overhead``: what search, store and evaluator take of a run's wall time; the
evaluator's part by CPU time beside a bare loop of reset, step and a look at success in the same scenes with the same
policy. ``workers``: two processes against one.

In the environment of docs/worlds.md: ``MUJOCO_GL=egl python scripts/meta_world_figures.py faults --out figures``.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from math import inf
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "docs" / "worlds"))

from meta_world import Late, MetaWorld, scripted  # type: ignore[import-not-found, unused-ignore]

from vlafuzz.api import fuzz
from vlafuzz.campaign.config import RunConfig, plan
from vlafuzz.common.plugins import trust
from vlafuzz.failures.causes import causes_of
from vlafuzz.model import Scene
from vlafuzz.policies.base import ActionSpec, Policy, PolicySpec
from vlafuzz.rollouts.setup import make_evaluator
from vlafuzz.store.store import Store
from vlafuzz.worlds.gym import GymPolicy, Now

WORLDS = Path(sys.path[0])
WORLD = "python:meta_world:MetaWorld"
SCENES, REPEATS = 40, 5  # of a run, by which the evaluator is timed; of each, of whose times the least counts
RUNS = 3  # with each number of workers


@dataclass(frozen=True)
class Fault:
    """The policy stands still where the parameter is above the threshold, or below it."""

    task: str
    parameter: str
    side: str
    threshold: float

    def holds(self, now: Now) -> bool:
        value = float(now.values[self.parameter])
        return value > self.threshold if self.side == "above" else value < self.threshold

    def __str__(self) -> str:
        return f"{self.task}: {self.parameter} {self.side} {self.threshold:g}"


FAULTS = (
    Fault("reach-v3", "goal-x", "above", 4),
    Fault("reach-v3", "hand-z", "above", 6),
    Fault("push-v3", "mass", "above", 2.5),
    Fault("push-v3", "object-x", "below", -5),
    Fault("pick-place-v3", "friction", "below", 0.6),
    Fault("pick-place-v3", "gravity", "above", 1.5),
    Fault("push-wall-v3", "object-y", "above", 2.5),
    Fault("push-wall-v3", "goal-y", "below", -3),
    Fault("pick-place-wall-v3", "hand-x", "above", 6),
    Fault("soccer-v3", "goal-x", "below", -6),
)


def late(task: str) -> str:
    """The name of the policy of a task that acts on what it saw four steps ago."""
    return f"python:meta_world:{task.removesuffix('-v3').replace('-', '_')}"


def run(store: Path, task: str, policy: Policy | str, budget: int, **flags: Any) -> Path:
    """The store of a run, its causes certified unless ``certify=False``."""
    trust(WORLD)
    store.unlink(missing_ok=True)
    fuzz(policy, task=f"{WORLD}/{task}", budget=budget, store=store, **flags)
    return store


def planted(folder: Path, fault: Fault, budget: int, seed: int) -> str:
    """Run a policy with a fault; a line that says what was found."""

    def act(now: Now) -> Any:
        return np.zeros(4, dtype=np.float32) if fault.holds(now) else scripted(now.task, now.observation)

    name = f"{fault.task}-{fault.parameter}-{fault.side}-{fault.threshold:g}"
    policy = GymPolicy(MetaWorld().opened(fault.task), PolicySpec(name, action=ActionSpec(width=4)), act)
    store = run(folder / f"{name}.db", fault.task, policy, budget, seed=seed)
    usual = {one.name: one for one in MetaWorld.parameters}
    with Store.open(store) as opened:
        listed = causes_of(opened, opened.runs()[-1])
        minimal = {one.shrunk.digest: one for one in opened.triaged() if one.shrunk and one.bucket == "minimal"}
    rows = listed.causes if listed else ()
    for rank, cause in enumerate(rows, 1):
        found = minimal.get(cause.scene or "")
        values = found.shrunk.values if found and found.shrunk else ()
        if not found or {name for name, value in values if value != usual[name].nominal} != {fault.parameter}:
            continue
        at = {path: number for one in found.causes.thresholds for path, number in dict(one.at).items()}
        where, step = float(at[f"values.{fault.parameter}"]), usual[fault.parameter].step
        near = abs(where - fault.threshold) <= step * (1 + 1e-9)
        return f"{'found' if near else 'FAR'}   {fault}: cause {rank} of {len(rows)}, from {where:.4g} (step {step:g})"
    return f"MISSED  {fault}: {' | '.join(', '.join(cause.conditions) for cause in rows) or 'no cause'}"


def weak(folder: Path, task: str, budget: int, seed: int) -> str:
    """Run the late policy; its list of causes."""
    store = run(folder / f"weak-{task}.db", task, late(task), budget, seed=seed)
    with Store.open(store) as opened:
        last = opened.runs()[-1]
        listed, (failed, judged) = causes_of(opened, last), opened.judged([last.id])
    rows = [f"  {', '.join(cause.conditions)}: {cause.says}" for cause in listed.causes] if listed else []
    return "\n".join([f"{task}: {failed} of {judged} scenes failed: {store}", *(rows or ["  no cause"])])


def overhead(folder: Path, task: str, budget: int, seed: int) -> str:
    """What vlafuzz takes of a run's wall time: search and store beside rollouts, and the evaluator in them."""
    run(folder / "imports.db", task, late(task), 8, seed=seed, certify=False)  # whose time is no rollout's
    began = time.perf_counter()
    store = run(folder / f"overhead-{task}.db", task, late(task), budget, seed=seed, certify=False)
    wall = time.perf_counter() - began
    with Store.open(store) as opened:
        ran = [trial for trial in opened.trials(1) if trial.outcome.rollouts and not trial.duplicate]
    began = time.perf_counter()
    MetaWorld().make(task).close()  # which a bare loop does, too, once
    made = time.perf_counter() - began
    beside = 1 - (made + sum(trial.outcome.rollouts[0].seconds for trial in ran)) / wall
    scenes = [trial.scene for trial in ran[:: max(1, len(ran) // SCENES)]]
    planned = plan(RunConfig(task=f"{WORLD}/{task}", policy=late(task), store=store))
    evaluator = make_evaluator(planned.manifest, planned.policy)
    world = evaluator._world  # type: ignore[attr-defined] # the very environment: another lies elsewhere in memory
    policy, lengths = Late(task), [len(evaluator.evaluate([scene])[0].rollouts[0].actions) for scene in scenes]

    def inside(scene: Scene, length: int) -> None:
        evaluator.evaluate([scene])

    def bare(scene: Scene, length: int) -> None:
        env, solved = world._env, False
        world.apply(env, world.values_in(scene))
        observation, _ = env.reset(seed=evaluator.seed)
        policy.reset(evaluator.seed)
        for _ in range(length):
            observation, _, terminated, truncated, info = env.step(policy.act(observation))
            solved = solved or bool(info["success"])
            if terminated or truncated:
                break

    spent = {inside: 0.0, bare: 0.0}
    for scene, length in zip(scenes, lengths, strict=True):
        least = dict.fromkeys(spent, inf)  # of several, as in timeit: what other processes add is none of either way
        for number in range(2 * REPEATS):
            way = (inside, bare)[number % 2]
            began = time.process_time()
            way(scene, length)
            least[way] = min(least[way], time.process_time() - began)
        for way in spent:
            spent[way] += least[way]
    steps = sum(lengths)
    within = 1 - spent[bare] / spent[inside]
    parts = f"{beside:.1%} beside rollouts, evaluator {within:.1%} of them"
    took = f"{steps} steps of {1e6 * spent[bare] / steps:.0f} µs bare, with resets"
    return f"{task}: {1 - (1 - beside) * (1 - within):.1%} of {wall:.1f} s of {budget} rollouts: {parts} ({took})"


def workers(folder: Path, task: str, budget: int, seed: int) -> str:
    """``vlafuzz run`` with one process and with two, in turn; it needs two cores that nobody else uses.

    Beside wall times: how many seconds of rollouts a second of the command holds. What a core's speed is at the moment,
    and what two processes take from each other, is no part of that.
    """
    wall, held = {1: inf, 2: inf}, {1: 0.0, 2: 0.0}  # the best of several, as in ``overhead``
    for number in (1, 2) * RUNS:
        store = folder / f"workers-{task}-{number}.db"
        store.unlink(missing_ok=True)
        asked = f"--world {WORLD}:{task} --policy {late(task)} --strategy random --unchecked --json"
        how = [*asked.split(), "--budget", str(budget), "--seed", str(seed), "--workers", str(number)]
        began = time.perf_counter()
        command = [sys.executable, "-m", "vlafuzz", "run", *how, "--store", str(store.resolve())]
        subprocess.run(command, cwd=WORLDS, check=True, capture_output=True)
        took = time.perf_counter() - began
        with Store.open(store) as opened:
            ran = [trial.outcome.rollouts for trial in opened.trials(1) if not trial.duplicate]
        rolled = sum(one.seconds for rollouts in ran for one in rollouts)
        wall[number], held[number] = min(wall[number], took), max(held[number], rolled / took)
    times = f"{wall[1]:.1f} s with one worker, {wall[2]:.1f} s with two ({wall[1] / wall[2]:.2f} ×)"
    share = f"{held[1]:.2f} and {held[2]:.2f} s of rollouts a second ({held[2] / held[1]:.2f} ×)"
    return f"{task}: {budget} rollouts take {times}; {share}; load {os.getloadavg()[0]:.1f}"


WORK: dict[str, Callable[..., str]] = {"faults": planted, "weak": weak, "overhead": overhead, "workers": workers}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=list(WORK))
    parser.add_argument("--out", type=Path, default=Path("figures"), help="folder of the stores")
    parser.add_argument("--budget", type=int, default=200, help="rollouts of each run")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", help="those whose name has this in it")
    parser.add_argument("--jobs", type=int, default=1, help="runs at a time; times need 1")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    over = FAULTS if options.what == "faults" else MetaWorld.tasks
    chosen = [one for one in over if options.only in str(one)]
    with ProcessPoolExecutor(options.jobs, get_context("spawn")) as pool:
        how = (options.out, options.budget, options.seed)
        for done in [pool.submit(WORK[options.what], how[0], one, *how[1:]) for one in chosen]:
            print(done.result(), flush=True)


if __name__ == "__main__":
    main()
