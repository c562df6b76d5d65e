"""Severity: how far the ranges of a run reach, and how far they have to for a policy to fail in one half."""

from __future__ import annotations

from dataclasses import replace

from vlafuzz.campaign.options import LEAST, RunConfig
from vlafuzz.search.severity import NAME, Half

# A quarter of the budget finds the severity: with 60 rollouts its 95 % interval is .17 to .28 wide in simulation.
SHARE, FEWEST = 4, 20


def probing(config: RunConfig, budget: int) -> RunConfig:
    """The run that finds out at which severity the policy fails in one half, before a run of this budget."""
    return replace(config, severity=1.0, strategy=NAME, budget=max(FEWEST, budget // SHARE))


def settled(config: RunConfig, half: Half, left: int) -> RunConfig:
    """The run that follows, with what is left of the budget."""
    return replace(config, severity=min(max(round(half.value, 2), LEAST), 1.0), budget=max(left, config.repeats))
