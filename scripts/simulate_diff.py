#!/usr/bin/env python
"""How often `vlafuzz diff` calls a cause fixed: against the same policy, and against one that has mended it.

Causes have a minimal scene or several, in which the policy fails with a given probability, whatever certified it. The
other policy is the same with other noise, or one that fails in these scenes with another probability.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from vlafuzz.common.assets import corpus_dir
from vlafuzz.common.statistics import wilson
from vlafuzz.failures.corpus.diff import Known, diff
from vlafuzz.failures.corpus.folder import read_corpus
from vlafuzz.failures.corpus.pairs import Probe
from vlafuzz.failures.corpus.regress import Asked
from vlafuzz.model import Outcome, Verdict

FRESH = 20_000  # smaller seeds were used while the test was made
RATES, SCENES = (0.5, 0.7, 0.9, 1.0), (1, 2, 4)
MENDED = (0.0, 0.1, 0.3)


class Chance:
    """A side that fails with one probability."""

    def __init__(self, name: str, rate: float, rng: np.random.Generator) -> None:
        self.name, self._rate, self._rng = name, rate, rng

    def answers(self, asked: Sequence[Asked]) -> Iterator[Outcome]:
        return (Outcome(verdict=Verdict.FAILED if self._rng.random() < self._rate else Verdict.PASSED) for _ in asked)


def standings(known: Known, rate: float, other: float, seeds: range) -> Counter[str]:
    """What became of the cause of a policy, by comparison."""
    nothing, counts = replace(known, causes={}, probes=()), Counter[str]()
    for seed in seeds:
        rng = np.random.default_rng([seed, round(100 * rate), round(100 * other), len(known.causes)])
        sides = (Chance("first", rate, rng), Chance("second", other, rng))
        counts.update(cause.standing for cause in diff(known, nothing, sides, sides).causes)
    return counts


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--causes", type=int, default=1000, help="of each kind")
    parser.add_argument("--seed", type=int, default=FRESH, help="of the first cause")
    options = parser.parse_args()
    corpus = read_corpus(corpus_dir() / "mini-pick-up")
    seeds = range(options.seed, options.seed + options.causes)
    for number in SCENES:
        failing = [case.scene for case in corpus.cases[:number]]
        known = Known(
            source=Path("simulated"),
            model=corpus.tested,
            runs=corpus.runs,
            causes=dict.fromkeys(failing, "the cause"),
            probes=[Probe(scene, "failing", "the cause", 0, passed=False) for scene in failing],
        )
        for rate in RATES:
            for other in (rate, *MENDED):
                fixed = standings(known, rate, other, seeds)["fixed"]
                low, high = wilson(fixed, len(seeds))
                what = "itself" if other == rate else f"one that fails {other:4.0%}"
                share = f"{fixed / len(seeds):6.1%} ({low:.1%}-{high:.1%})"
                print(f"{number} scenes, fails {rate:4.0%}, against {what:20} fixed {share}", flush=True)


if __name__ == "__main__":
    main()
