#!/usr/bin/env python
"""How often `vlafuzz regress` notices the loss that it states, and how often equal policies raise an alarm.

Controls are drawn, recorded and compared as on the command line; only scenes and policies are made up. A policy passes
in a scene with a probability of its own, whose mean is the given rate: the same in every scene (`chance`), always or
never (`scenes`), or nearly so (`mixed`). The new policy does so in other scenes. It passes as often as the baseline, or
less often: by the loss that was stated for that very corpus, or by 10 points. With ``--nights N`` there is a comparison
with each corpus in each of N nights, at a level of alpha / N, of the same equal policy with other noise, and of one
that lost 10 points, in seven nights.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import product
from math import ceil
from typing import cast

import numpy as np

from vlafuzz.common.assets import corpus_dir
from vlafuzz.common.statistics import wilson
from vlafuzz.common.watch import SILENT
from vlafuzz.failures.corpus import controls
from vlafuzz.failures.corpus.corpus import Corpus
from vlafuzz.failures.corpus.folder import read_corpus
from vlafuzz.failures.corpus.pairs import Probe
from vlafuzz.failures.corpus.regress import Recorded, Rerun, compare
from vlafuzz.failures.corpus.sign_test import power_of
from vlafuzz.model import Outcome, Scene, Space, Verdict
from vlafuzz.rollouts.scene_runner import SceneRunner
from vlafuzz.store.records import Manifest

RATES, NUMBERS = (0.05, 0.3, 0.5, 0.8, 0.95), (40, 200)
CERTAINTY = {"chance": 0.0, "scenes": 1.0, "mixed": 0.9}  # how far a scene decides the outcome
ALPHA = 0.05
FRESH = 20_000  # smaller seeds were used while the test and the power were made
SCENES = 2000  # more than are drawn for any corpus
STEP = 1e-6  # metres between scenes, which are told apart by the place of the target


class Policy:
    """A runner that passes in random scenes, each told by its number."""

    deterministic = True
    space = cast(Space, None)

    def __init__(self, kind: str, rate: float, seed: Sequence[int], night: int = 0) -> None:
        self._rng, self._rate, self._certain = np.random.default_rng([*seed, night]), rate, CERTAINTY[kind]
        self._decided = np.random.default_rng(seed).random(SCENES) < rate

    def evaluate(self, scenes: Sequence[Scene], numbers: Sequence[int]) -> list[Outcome]:
        return [Outcome(verdict=Verdict.PASSED if self._passes(scene) else Verdict.FAILED) for scene in scenes]

    def close(self) -> None:
        """Nothing to release."""

    def _passes(self, scene: Scene) -> bool:
        decided = self._decided[round(scene.targets[0].x / STEP)]
        return bool(decided if self._rng.random() < self._certain else self._rng.random() < self._rate)


def simulate(template: Corpus, kind: str, rate: float, number: int, seed: int, nights: int) -> dict[str, bool] | None:
    """What raises an alarm; None if nothing can."""
    base = template.controls[0].scene

    def draw(space: Space, seed: int, number: int) -> Scene:
        return replace(base, targets=(replace(base.targets[0], x=number * STEP), *base.targets[1:]))

    controls.draw = draw
    baseline = cast(SceneRunner, Policy(kind, rate, [seed, 0]))
    recorded = controls.record(baseline, seed, number, SILENT)
    power = power_of([control.passed for control in recorded], ALPHA / nights)
    if not power.possible:
        return None
    left = 0.0 if power.total else max(0.0, rate - ceil(100 * power.loss) / 100)
    probes = [Probe(control.scene, "control", "random", 0, control.passed) for control in recorded]

    def alarm(passing: float, number: int, within: int = 1) -> bool:
        def make_at(night: int) -> Callable[[Manifest], SceneRunner]:
            return lambda run: cast(SceneRunner, Policy(kind, passing, [seed, number], night))

        return any(
            compare(probes, Rerun("new", template.runs, make_at(night)), Recorded("old"), alpha=ALPHA / nights).alarm
            for night in range(within)
        )

    less = max(0.0, rate - 0.1)
    found = {"false alarms": alarm(rate, 1, nights), "stated loss": alarm(left, 2), "10 points": alarm(less, 3)}
    return found | ({"in 7 nights": alarm(less, 3, 7)} if nights > 1 else {})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--corpora", type=int, default=200, help="of each shape")
    parser.add_argument("--kinds", nargs="+", default=list(CERTAINTY), choices=list(CERTAINTY))
    parser.add_argument("--rates", type=float, nargs="+", default=RATES)
    parser.add_argument("--nights", type=int, default=1)
    parser.add_argument("--seed", type=int, default=FRESH, help="of the first corpus")
    options = parser.parse_args()
    template = read_corpus(corpus_dir() / "mini-pick-up")
    for kind, rate, number in product(options.kinds, options.rates, NUMBERS):
        seeds = range(options.seed, options.seed + options.corpora)
        results = [simulate(template, kind, rate, number, seed, options.nights) for seed in seeds]
        possible = [result for result in results if result]
        names = possible[0] if possible else {}
        shares = "  ".join(f"{name} {_share([result[name] for result in possible])}" for name in names)
        print(f"{kind:8}passes {rate:4.0%} of {number:3}: possible {len(possible):3}  {shares}", flush=True)


def _share(alarms: Sequence[bool]) -> str:
    low, high = wilson(sum(alarms), len(alarms)) if alarms else (0.0, 1.0)
    return f"{sum(alarms):3} of {len(alarms):3} ({low:.1%}-{high:.1%})"


if __name__ == "__main__":
    main()
