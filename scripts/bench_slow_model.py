#!/usr/bin/env python
"""Rollouts per hour behind a slow model: one scene at a time, against as many at a time as its server takes.

The model is `random` behind a vla-eval server in this process. It sleeps for each answer, longer for a batch of several
observations: by default 50 ms for one and 80 ms for eight, a tenth of what a large model takes. It needs no pictures.
Both ways evaluate the same scenes, in turns, and must go through the same states.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before the first import of NumPy and torch

import argparse
import json
import statistics
import time
from collections.abc import Sequence
from contextlib import ExitStack, closing
from dataclasses import replace
from functools import partial
from itertools import count
from pathlib import Path

import numpy as np
from timed_rollouts import timed_rollouts

from vlafuzz.model import Conditions, Scene
from vlafuzz.policies.base import ActionChunk, Observation
from vlafuzz.policies.controls import Random
from vlafuzz.policies.serving import serving
from vlafuzz.rollouts.executor import Executor
from vlafuzz.rollouts.policies import make_policy
from vlafuzz.rollouts.registry import Place, executor_at
from vlafuzz.rollouts.setup import make_evaluator
from vlafuzz.worlds.tabletop.objects.catalogue import load_catalogue
from vlafuzz.worlds.tabletop.space import SearchSpace, load_operators

TASK = "pick-up"
ALONE, TOGETHER = "alone", "together"
GOAL = 3.0  # times the rate of scenes alone


class Sleeping(Random):
    """Answers after ``one`` seconds, for a batch of ``max_batch`` after ``full`` seconds."""

    def __init__(self, one: float, full: float, max_batch: int) -> None:
        super().__init__()
        self.spec = replace(self.spec, name="sleeping", max_batch=max_batch)
        self._one, self._full = one, full
        self.batches: list[int] = []

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        size = len(observations)
        self.batches.append(size)
        time.sleep(self._one + (self._full - self._one) * (size - 1) / max(self.spec.max_batch - 1, 1))
        return super().act(observations)


def rollouts(executor: Executor, scenes: list[Scene]) -> tuple[float, list[str]]:
    """Rollouts per hour, and the hashes of all states."""
    seconds, done = timed_rollouts(executor, scenes)
    return 3600 * len(done) / seconds, [rollout.states_hash for rollout in done]


def main() -> None:
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    parser.add_argument("--one", type=float, default=0.05, help="seconds for an answer")
    parser.add_argument("--full", type=float, default=0.08, help="seconds for a whole batch")
    parser.add_argument("--batch", type=int, default=8, help="observations in a whole batch")
    parser.add_argument("--scenes", type=int, default=8, help="per round")
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0, help="of the scenes")
    parser.add_argument("--json", type=Path, help="file to write the figures to")
    options = parser.parse_args()
    model = Sleeping(options.one, options.full, options.batch)
    catalogue, operators = load_catalogue(), load_operators()
    space = SearchSpace(operators, catalogue, TASK)
    drawn = (space.sample(np.random.default_rng([options.seed, number])) for number in count())
    make = partial(make_evaluator, Conditions(task=TASK, world={"min_distance": operators.min_distance}), checked=False)
    rates: dict[str, list[float]] = {ALONE: [], TOGETHER: []}
    batches: dict[str, float] = {}
    with serving(model) as address, ExitStack() as stack:
        executors = {
            kind: stack.enter_context(closing(executor_at(Place(), make, make_policy(f"{address}&batch={batch}"))))
            for kind, batch in ((ALONE, 1), (TOGETHER, options.batch))
        }
        for kind, executor in executors.items():  # makes all simulators
            rollouts(executor, [next(drawn)] * (1 if kind == ALONE else options.batch))
        for _ in range(options.rounds):
            scenes, states = [next(drawn) for _ in range(options.scenes)], []
            for kind, executor in executors.items():
                model.batches.clear()
                rate, hashes = rollouts(executor, scenes)
                rates[kind].append(rate)
                states.append(hashes)
                batches[kind] = statistics.mean(model.batches)
            assert states[0] == states[1], "together, the scenes went through other states"
    ratio = statistics.median(np.divide(rates[TOGETHER], rates[ALONE]).tolist())
    print(f"{options.one:g} s for an answer, {options.full:g} s for {options.batch} at once")
    for kind, measured in rates.items():
        per_hour = statistics.median(measured)
        print(f"{kind:9}{per_hour:7.0f} rollouts/h, {batches[kind]:.1f} observations in a call")
    print(f"{ratio:.2f} times as many; goal {GOAL:g}: {'reached' if ratio >= GOAL else 'MISSED'}")
    if options.json:
        report = {"rollouts_per_hour": rates, "batches": batches, "ratio": ratio}
        options.json.write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
