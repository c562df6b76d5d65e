"""Severity: how far the ranges of a run reach, and how far they have to for a policy to fail in one half."""

from __future__ import annotations

from dataclasses import replace

from vlafuzz.campaign.options import LEAST, RunConfig
from vlafuzz.model.outcome import Verdict
from vlafuzz.search.severity import NAME, Half, half_of, severity_of
from vlafuzz.store.store import Store

# A quarter of the budget finds the severity: with 60 rollouts its 95 % interval is .17 to .28 wide in simulation.
SHARE, FEWEST = 4, 20


def probing(config: RunConfig, budget: int) -> RunConfig:
    """The run that finds out at which severity the policy fails in one half, before a run of this budget."""
    return replace(config, severity=1.0, strategy=NAME, budget=max(FEWEST, budget // SHARE))


def settled(config: RunConfig, half: Half, left: int) -> RunConfig:
    """The run that follows, with what is left of the budget."""
    return replace(config, severity=min(max(round(half.value, 2), LEAST), 1.0), budget=max(left, config.repeats))


def half_of_run(store: Store, run: int) -> Half:
    """The severity at which one half fails, by a run of the strategy ``severity``."""
    judged = [trial for trial in store.trials(run) if trial.outcome.verdict in (Verdict.PASSED, Verdict.FAILED)]
    return half_of([(severity_of(trial.proposal), trial.outcome.verdict is Verdict.FAILED) for trial in judged])


def in_words(half: Half) -> str:
    """The severity at which one half fails, as a phrase."""
    if half.low >= 1:
        return "above 1: fewer than one half fail in the whole ranges"
    if half.high <= 0:
        return "0: nominal scenes fail as often"
    return f"{half.value:.2f} of the ranges, 95% interval {half.low:.2f}–{half.high:.2f}{'+' * (half.high >= 1)}"
