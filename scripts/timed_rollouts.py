"""Rollouts that an executor makes of some scenes, and the time that they take; for benches."""

from __future__ import annotations

import time
from collections.abc import Sequence

from vlafuzz.model import Rollout, Scene, Verdict
from vlafuzz.rollouts.executor import Executor


def timed_rollouts(executor: Executor, scenes: Sequence[Scene]) -> tuple[float, list[Rollout]]:
    """Seconds, and the rollouts in the order of the scenes; a RuntimeError when one broke."""
    began = time.perf_counter()
    results = dict(executor.run(enumerate(scenes)))
    seconds = time.perf_counter() - began
    outcomes = [results[number] for number in range(len(scenes))]
    if broken := [outcome.detail for outcome in outcomes if outcome.verdict is Verdict.ERROR]:
        raise RuntimeError(broken[0])
    return seconds, [rollout for outcome in outcomes for rollout in outcome.rollouts]
