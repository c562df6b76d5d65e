#!/usr/bin/env python
"""Coverage and width of the failure probability's interval, in guided searches whose probability is known.

A world has uniform genes and faults, which are boxes of one to three of them; in every other world a scene in a box
fails 7 times of 10 instead of always. Half of the rollouts of a search are plain draws; the others attribute failures,
8 to 12 for each, or are scenes that the probability does not rest on. An attribution makes a rule, a box with imprecise
edges. Mean predictions come from scenes without rollouts, as in a real search. Widths are compared with Wilson's
interval of as many random rollouts as the whole budget. The interval of a run that may stop at any time counts as
covering if it does so after each of 25 numbers of draws.
"""

from __future__ import annotations

import argparse
import json
import math
from collections import deque
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from statistics import median

import numpy as np
from numpy.typing import NDArray

from vlafuzz.common.statistics import wilson
from vlafuzz.search.probability import Draw, Rates, failure_probability

Array = NDArray[np.float64]

GENES, POOL = 12, 2000
SHARES = np.array([0.35, 0.2, 0.15, 0.1, 0.08, 0.06, 0.04, 0.02])
RATES = (0.95, 0.5, 0.3, 0.05, 0.01, 0.002)
TIMES = 25  # at which the interval is looked at while a search goes on
FRESH = 10_000  # the bets were chosen with smaller seeds


@dataclass(frozen=True)
class Box:
    genes: NDArray[np.int64]
    low: Array
    high: Array

    def holds(self, scenes: Array) -> NDArray[np.bool_]:
        values = scenes[..., self.genes]
        return np.asarray(((values >= self.low) & (values <= self.high)).all(axis=-1))


def union(boxes: list[Box]) -> float:
    """Probability that a uniform scene is in one of the boxes: inclusion and exclusion."""
    low, high = np.zeros((len(boxes), GENES)), np.ones((len(boxes), GENES))
    for number, box in enumerate(boxes):
        low[number, box.genes], high[number, box.genes] = box.low, box.high
    total = 0.0
    for size in range(1, len(boxes) + 1):
        of = np.array(list(combinations(range(len(boxes)), size)))
        sides = np.clip(high[of].min(axis=1) - low[of].max(axis=1), 0, None)
        total -= (-1) ** size * float(sides.prod(axis=1).sum())
    return total


class World:
    """Faults that make the policy fail in a random scene with a probability of about ``rate``."""

    def __init__(self, rate: float, rng: np.random.Generator, *, flaky: bool) -> None:
        number = 8 if rate >= 0.05 else 4 if rate >= 0.01 else 2
        self._genes = [rng.choice(GENES, rng.integers(1, 4), replace=False) for _ in range(number)]
        self._starts = [
            np.where(rng.random(len(genes)) < 0.3, rng.random(len(genes)), rng.integers(0, 2, len(genes)))
            for genes in self._genes
        ]
        shares = SHARES[:number] * rng.uniform(0.5, 1.5, number)
        self.fails = 0.7 if flaky else 1.0
        low, high = 0.0, 0.6
        for _ in range(20):
            scale = (low + high) / 2
            self.boxes = self._place(scale * shares / shares.max())
            low, high = (scale, high) if union(self.boxes) * self.fails < rate else (low, scale)
        self.rate = union(self.boxes) * self.fails

    def _place(self, shares: Array) -> list[Box]:
        widths = [share ** (1 / len(genes)) for share, genes in zip(shares, self._genes, strict=True)]
        return [
            Box(genes, start * (1 - width), start * (1 - width) + width)
            for genes, start, width in zip(self._genes, self._starts, widths, strict=True)
        ]


@dataclass(frozen=True, kw_only=True)
class Search:
    """How scenes are drawn, and how good the rules are.

    Args:
        plain: share of rollouts that are plain draws; the others attribute failures, or are draws that do not count.
        wrong: share of rules with a gene too few or with other genes.
        guided: whether failures are attributed; otherwise there are no rules.
    """

    plain: float = 0.5
    wrong: float = 0.1
    guided: bool = True

    def draws(self, world: World, budget: int, rng: np.random.Generator) -> list[Draw]:
        pool = rng.random((POOL, GENES))
        predicted, rules, rates = np.zeros(POOL, dtype=bool), list[Box](), Rates()
        draws, left, rolled, waiting = list[Draw](), budget, 0, deque[Array]()
        while left > 0:
            if self.guided and rolled >= self.plain * (budget - left):
                left -= int(rng.integers(8, 13)) if waiting else 1
                if waiting and not any(rule.holds(waiting[0]) for rule in rules):
                    rules.append(self._rule(world, waiting[0], rng))
                    predicted |= rules[-1].holds(pool)
                if waiting:
                    waiting.popleft()
                continue
            scene = rng.random(GENES)
            explained = any(rule.holds(scene) for rule in rules)
            chance, share = rates.chance(explained=explained), float(predicted.mean())
            failed = None
            draw = Draw(
                scene=scene.tobytes(),
                chance=chance,
                prediction=rates.predict(explained),
                mean_prediction=rates.predict(share),
                error=abs(rates.predict(1) - rates.predict(0)) * math.sqrt(share * (1 - share) / POOL),
            )
            if rng.random() < chance:
                left, rolled = left - 1, rolled + 1
                failed = any(box.holds(scene) for box in world.boxes) and bool(rng.random() < world.fails)
                rates.learn(explained=explained, failed=failed)
                if failed and not explained:
                    waiting.append(scene)
            draws.append(replace(draw, failed=failed))
        return draws

    def _rule(self, world: World, scene: Array, rng: np.random.Generator) -> Box:
        """A box around the scene, imprecisely: edges inside the range are off by a tenth of the width."""
        box = next(box for box in world.boxes if box.holds(scene))
        genes, width = box.genes, box.high - box.low
        if rng.random() < self.wrong:
            fewer = len(genes) > 1 and rng.random() < 0.5
            genes = genes[1:] if fewer else rng.choice(GENES, len(genes), replace=False)
            start = scene[genes] - width[: len(genes)] * rng.random(len(genes))
            return Box(genes, start, start + width[: len(genes)])
        low = np.where(box.low > 0, box.low + 0.1 * width * rng.normal(size=len(genes)), 0)
        high = np.where(box.high < 1, box.high + 0.1 * width * rng.normal(size=len(genes)), 1)
        return Box(genes, np.minimum(low, scene[genes]), np.maximum(high, scene[genes]))


SEARCHES = {
    "plain random": Search(guided=False),
    "half of the rollouts are plain draws": Search(),
    "the same, half of the rules wrong": Search(wrong=0.5),
}


def simulate(search: Search, rate: float, seeds: range, budget: int) -> dict[str, float]:
    covered, always, wider = 0, 0, list[float]()
    widths, plain, errors, numbers = list[float](), list[float](), list[float](), list[int]()
    for seed in seeds:
        rng = np.random.default_rng([seed, round(rate * 1000)])
        world = World(rate, rng, flaky=seed % 2 == 1)
        draws = search.draws(world, budget, rng)
        value, low, high = failure_probability(draws, over=True)
        times = np.unique(np.geomspace(1, len(draws), TIMES).astype(int))
        running = [failure_probability(draws[:number], over=False)[1:] for number in times]
        always += all(low_then <= world.rate <= high_then for low_then, high_then in running)
        wider.append(running[-1][1] - running[-1][0])
        random = wilson(int(rng.binomial(budget, world.rate)), budget)
        covered += low <= world.rate <= high
        widths.append(high - low)
        plain.append(random.high - random.low)
        errors.append(value - world.rate)
        numbers.append(len(draws))
    error = math.sqrt(float(np.mean(np.square(errors))) / (rate * (1 - rate) / budget))
    figures = {
        "covered": covered,
        "always": always,
        "worlds": len(seeds),
        "width": median(widths),
        "wilson": median(plain),
    }
    ratio = figures["width"] / figures["wilson"]
    means = float(np.mean(widths) / np.mean(plain))
    figures |= {"ratio at any time": median(wider) / figures["wilson"]}
    return figures | {"ratio": ratio, "ratio of means": means, "error": error, "draws": float(np.mean(numbers))}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worlds", type=int, default=500, help="of each search and each probability")
    parser.add_argument("--budget", type=int, default=300, help="policy rollouts")
    parser.add_argument("--seed", type=int, default=FRESH, help=f"of the first world; bets: below {FRESH}")
    parser.add_argument("--search", choices=list(SEARCHES), action="append", help="default: all")
    parser.add_argument("--out", type=Path, help="JSON file for the figures")
    options = parser.parse_args()
    results: dict[str, dict[float, dict[str, float]]] = {}
    print(
        "p, coverage, median width / Wilson's (of means), at any time the same, error / plain random's, draws",
        flush=True,
    )
    for name in options.search or SEARCHES:
        results[name] = {}
        for rate in RATES:
            seeds = range(options.seed, options.seed + options.worlds)
            row = results[name][rate] = simulate(SEARCHES[name], rate, seeds, options.budget)
            text = f"{row['covered'] / row['worlds']:6.1%}  {row['ratio']:.2f} ({row['ratio of means']:.2f})"
            text += f"  {row['always'] / row['worlds']:6.1%}  {row['ratio at any time']:.2f}"
            print(f"{name:50}{rate:<7}{text}  {row['error']:.2f}  {row['draws']:.0f}", flush=True)
        counts = [sum(row[key] for row in results[name].values()) for key in ("covered", "worlds")]
        low, high = wilson(*counts)
        print(f"{name:50}all    {counts[0] / counts[1]:6.1%} ({low:.1%}-{high:.1%})", flush=True)
    if options.out:
        options.out.write_text(json.dumps(results, indent=1) + "\n")


if __name__ == "__main__":
    main()
