#!/usr/bin/env python
"""What ending failing rollouts early would save, and what it would change.

Random fair scenes at the default ranges are rolled out to the end. For each rule, the report says how often a failing
rollout met it, what share of the control steps of failing rollouts came after that, and how many rollouts, passed ones
included, reached a stage or made progress after it: a rule that is safe has none.

off the table        a target more than 0.2 m below its top
out of reach         the first target at rest more than 1 m from the robot's base
same state           all objects, the hand and the action equal, bit by bit, to those of an earlier step
nothing moves        all of them within 0.01 mm and 0.01 mrad of those of the three steps before
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before the first import of NumPy and torch

import argparse
import json
from collections import defaultdict
from itertools import count
from typing import NamedTuple
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray

from vlafuzz.campaign.config import RunConfig, plan
from vlafuzz.model import Verdict
from vlafuzz.rollouts.setup import make_evaluator
from vlafuzz.worlds.manipulation.rigs import PANDA
from vlafuzz.worlds.tabletop.sim.env import TabletopEnv
from vlafuzz.worlds.tabletop.space import SearchSpace
from vlafuzz.worlds.tabletop.tasks import TASKS, State

BELOW, REACH, STILL, STEPS = -0.2, 1.0, 1e-5, 3  # metres, metres, metres or radians, steps


class Step(NamedTuple):
    """A control step: numbers that decide the next one, and where the rollout is."""

    numbers: NDArray[np.float64]
    lost: bool
    beyond: bool
    reached: int
    progress: float


def record(env: TabletopEnv, state: State, action: NDArray[np.float64]) -> Step:
    parts = (state.positions, state.rotations, state.tcp, state.tcp_rotation, state.opening, action)
    x, y, _ = state.positions[0] - PANDA.base
    return Step(
        numbers=np.concatenate([np.ravel(part) for part in parts]),
        lost=bool((state.positions[: env.task.targets, 2] < BELOW).any()),
        beyond=state.at_rest(0) and float(np.hypot(x, y)) > REACH,
        reached=len(env.monitor.reached),
        progress=env.monitor.progress,
    )


def first_met(steps: list[Step]) -> dict[str, int]:
    """The first step at which each rule is met, if any."""
    seen: set[bytes] = set()
    met: dict[str, int] = {}
    for number, step in enumerate(steps):
        before = steps[max(number - STEPS, 0) : number]
        still = [np.abs(step.numbers - earlier.numbers).max() < STILL for earlier in before]
        rules = {
            "off the table": step.lost,
            "out of reach": step.beyond,
            "same state": step.numbers.tobytes() in seen,
            "nothing moves": len(still) == STEPS and all(still),
        }
        seen.add(step.numbers.tobytes())
        met = {rule: number for rule, holds in rules.items() if holds} | met
    return met


def measure(policy: str, task: str, rollouts: int, seed: int) -> dict[str, object]:
    setup = plan(RunConfig(task=task, policy=policy, strategy="random", seed=seed))
    assert isinstance(setup.space, SearchSpace)
    evaluator = make_evaluator(setup.manifest, setup.policy)
    steps: list[Step] = []
    advance = TabletopEnv.advance

    def recording(env: TabletopEnv, action: NDArray[np.float64], relative_to: str) -> State:
        state = advance(env, action, relative_to)
        steps.append(record(env, state, action))
        return state

    failed, of_failed, done = 0, 0, 0
    rules: dict[str, dict[str, int]] = defaultdict(lambda: {"met": 0, "saved": 0, "changed": 0})
    with patch.object(TabletopEnv, "advance", recording):
        for number in count():
            if done == rollouts:
                break
            steps.clear()
            (outcome,) = evaluator.evaluate([setup.space.sample(np.random.default_rng([seed, number]))])
            if outcome.verdict not in (Verdict.PASSED, Verdict.FAILED):
                continue
            done += 1
            fails, last = outcome.verdict is Verdict.FAILED, steps[-1]
            failed, of_failed = failed + fails, of_failed + fails * len(steps)
            for rule, at in first_met(steps).items():
                tally, step = rules[rule], steps[at]
                tally["met"] += fails
                tally["saved"] += fails * (len(steps) - at - 1)
                tally["changed"] += (step.reached, step.progress) != (last.reached, last.progress)
    evaluator.close()
    return {"rollouts": done, "failed": failed, "steps_of_failed": of_failed, "rules": rules}


def main() -> None:
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    parser.add_argument("--policy", default="pinhole")
    parser.add_argument("--rollouts", type=int, default=60, help="per task")
    parser.add_argument("--seed", type=int, default=0, help="of the scenes")
    options = parser.parse_args()
    for task in TASKS:
        report = measure(options.policy, task, options.rollouts, options.seed)
        print(json.dumps({"policy": options.policy, "task": task, **report}), flush=True)


if __name__ == "__main__":
    main()
