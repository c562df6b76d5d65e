#!/usr/bin/env python
"""Success rates of `mini` on fresh valid scenes, with 95 % intervals.

Sets: nominal (only targets vary), clutter (also 0 to 3 confounders), random (all default ranges), black (clutter, with
black images), other (clutter, with an instruction that names another object on the table: success still means the
scene's target), moved and disturbed (clutter, with events in mid-episode of the kinds in EVENTS), and mutations of
nominal scenes that it passes: rerun (none), light, camera, confounders (4), wording (those not used in training). Seeds
are below those of the demonstrations.
"""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from multiprocessing import get_context
from pathlib import Path
from statistics import fmean
from typing import Any

import numpy as np

from vlafuzz.common.statistics import wilson
from vlafuzz.model import Camera, Conditions, Light, Scene, Verdict
from vlafuzz.policies.base import ActionChunk, Observation
from vlafuzz.policies.mini.policy import CARD, SHIPPED, Mini
from vlafuzz.worlds.tabletop.objects import load_catalogue
from vlafuzz.worlds.tabletop.sim.env import ManiSkillEvaluator
from vlafuzz.worlds.tabletop.space import SearchSpace, load_operators
from vlafuzz.worlds.tabletop.tasks import TASKS, load_wordings, say

SEEN_WORDINGS = 4  # see make_demos.py
TARGETS = ("target-type", "target-position", "target-orientation")
CLUTTER = (*TARGETS, "confounder-type", "confounder-position", "confounder-orientation", "confounder-count")
# In mid-episode: recovery_mini.py demonstrates the first kinds, and never the others.
EVENTS = {
    "moved": ("target-slide", "goal-slide", "grip-slip"),
    "disturbed": ("target-topple", "camera-bump", "light-switch", "picture-loss", "control-stall", "grip-weak"),
}
MUTATED = ("rerun", "light", "camera", "confounders", "wording")
SETS = ("nominal", "clutter", "random", "black", "other", *EVENTS, *MUTATED)
CHUNK = 10  # scenes per job
Row = tuple[str, str, bool, int, float]  # task, set, passed, steps, seconds


class Blind(Mini):
    """Sees black images."""

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        dark = [
            replace(seen, images={name: np.zeros_like(picture) for name, picture in seen.images.items()})
            for seen in observations
        ]
        return super().act(dark)


@cache
def space(task: str, vary: tuple[str, ...] | None) -> SearchSpace:
    operators = load_operators()
    return SearchSpace(operators.only(vary) if vary else operators, load_catalogue(), task)


@cache
def evaluator(task: str, kind: str, weights: Path) -> ManiSkillEvaluator:
    policy = Blind(weights) if kind == "black" else Mini(weights)
    return ManiSkillEvaluator(
        Conditions(task=task, world={"min_distance": 0.15}, stop_early=True), policy, load_catalogue()
    )


def crowded(task: str) -> SearchSpace:
    return space(task, (*CLUTTER, "light", "camera-position", "camera-orientation"))


def draw(task: str, kind: str, seed: int) -> Scene:
    rng = np.random.default_rng([seed, *task.encode()])
    if kind == "nominal":
        return space(task, TARGETS).sample(rng)
    if kind == "random":
        return space(task, None).sample(rng)
    scene = space(task, (*CLUTTER, *EVENTS.get(kind, ()))).sample(rng)
    while kind in EVENTS and not scene.events:
        scene = space(task, (*CLUTTER, *EVENTS[kind])).sample(rng)
    while kind == "other" and not scene.confounders:
        scene = space(task, CLUTTER).sample(rng)
    if kind == "other":
        spoken = [load_catalogue()[thing.object].spoken for thing in (scene.confounders[0], *scene.targets[1:])]
        scene = replace(scene, instruction=say(load_wordings()[task][0], spoken))
    return scene


def mutant(base: Scene, full: Scene, kind: str, seed: int) -> Scene:
    """One mutation of a nominal scene; ``full`` is the same with four confounders."""
    rng = np.random.default_rng([seed, 7, *base.task.encode()])
    if kind == "light":
        return replace(base, light=Light(float(2 ** rng.uniform(-np.log2(20), np.log2(20)))))
    if kind == "camera":
        roll, pitch, yaw = rng.uniform(-5, 5, 3)
        direction = rng.normal(size=3)
        azimuth = np.degrees(np.arctan2(direction[1], direction[0]))
        elevation = np.degrees(np.arcsin(direction[2] / np.linalg.norm(direction)))
        return replace(base, camera=Camera(rng.uniform(0, 0.05), azimuth, elevation, roll=roll, pitch=pitch, yaw=yaw))
    if kind == "confounders":
        return full
    if kind == "wording":
        wordings = load_wordings()[base.task][SEEN_WORDINGS:]
        spoken = [load_catalogue()[target.object].spoken for target in base.targets]
        return replace(base, instruction=say(wordings[int(rng.integers(len(wordings)))], spoken))
    return base


@cache
def four(task: str) -> SearchSpace:
    """The space of clutter with exactly four confounders."""
    operators = load_operators(str(Path(__file__).with_name("four.yaml")))
    return SearchSpace(operators, load_catalogue(), task)


@dataclass(frozen=True)
class Job:
    """Scenes of one task and set, until ``count`` valid ones were run."""

    task: str
    kind: str
    first: int
    count: int
    weights: Path

    def run(self) -> list[Row]:
        """One row per counted rollout."""
        if self.kind == "mutated":
            return list(self._mutated())
        rows: list[Row] = []
        seed = self.first
        while len(rows) < self.count:
            (outcome,) = self._evaluator().evaluate([draw(self.task, self.kind, seed)])
            if outcome.verdict >= Verdict.PASSED:
                rows.append(self._row(self.kind, outcome))
            seed += 1
        return rows

    def _mutated(self) -> Iterator[Row]:
        evaluate: Callable[..., Any] = self._evaluator().evaluate
        passed, seed = 0, self.first
        while passed < self.count and seed < self.first + 5 * self.count:
            seed += 1
            full = four(self.task).sample(np.random.default_rng([seed, 3, *self.task.encode()]))
            base = replace(full, confounders=())
            if evaluate([base])[0].verdict is not Verdict.PASSED:
                continue
            passed += 1
            for kind in MUTATED:
                (outcome,) = evaluate([mutant(base, full, kind, seed)])
                if outcome.verdict >= Verdict.PASSED:
                    yield self._row(kind, outcome)

    def _row(self, kind: str, outcome: Any) -> Row:
        (rollout,) = outcome.rollouts
        return self.task, kind, outcome.verdict is Verdict.PASSED, rollout.steps, rollout.seconds

    def _evaluator(self) -> ManiSkillEvaluator:
        return evaluator(self.task, self.kind, self.weights)


def main() -> None:
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    parser.add_argument("--weights", type=Path, default=SHIPPED, help="folder of weights and card")
    parser.add_argument("--tasks", nargs="+", default=list(TASKS), choices=list(TASKS))
    parser.add_argument("--sets", nargs="+", default=list(SETS[:5]), choices=[*SETS[:7], "mutated"])
    parser.add_argument("--scenes", type=int, default=200, help="per task and set")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--out", type=Path, help="JSON file for the figures")
    parser.add_argument("--card", action="store_true", help="also write them into the model card")
    options = parser.parse_args()
    os.environ.update({"OMP_NUM_THREADS": "1", "LP_NUM_THREADS": "0"})
    jobs = [
        Job(task, kind, 10 * first, min(CHUNK, options.scenes - first), options.weights)
        for kind in options.sets
        for task in options.tasks
        for first in range(0, options.scenes, CHUNK)
    ]
    rows: list[Row] = []
    with get_context("spawn").Pool(options.workers) as pool:
        for part in pool.imap_unordered(Job.run, jobs):
            rows += part
    figures = summarise(rows, options.tasks)
    if options.out:
        options.out.write_text(json.dumps(figures, indent=1) + "\n")
    if options.card:
        note(figures, options.weights / CARD)


def summarise(rows: Sequence[Row], tasks: Sequence[str]) -> list[dict[str, Any]]:
    """Passed rollouts of each set and task; also printed."""
    figures = []
    for kind in SETS:
        for task in tasks:
            mine = [row for row in rows if row[:2] == (task, kind)]
            if not mine:
                continue
            passed, judged = sum(row[2] for row in mine), len(mine)
            low, high = wilson(passed, judged)
            steps, seconds = fmean(row[3] for row in mine), fmean(row[4] for row in mine)
            figures.append(
                {"set": kind, "task": task, "passed": passed, "of": judged}
                | {"low": round(low, 4), "high": round(high, 4)}
                | {"steps": steps, "seconds": seconds}
            )
            print(f"{kind:12}{task:11}{passed:4} of {judged:4} = {passed / judged:6.1%}", end="")
            print(f" ({low:.1%}-{high:.1%}){steps:7.1f} steps{1e3 * seconds:7.0f} ms", flush=True)
    return figures


def note(figures: Sequence[dict[str, Any]], path: Path) -> None:
    """Write the figures into the card, replacing those of the same sets and tasks."""
    card = json.loads(path.read_text())
    known = {(row["set"], row["task"]): row for row in [*card.get("success", []), *figures]}
    kept = ("set", "task", "passed", "of", "low", "high")
    card["success"] = [{key: row[key] for key in kept} for row in known.values()]
    path.write_text(json.dumps(card, indent=1) + "\n")


if __name__ == "__main__":
    main()
