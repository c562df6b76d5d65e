#!/usr/bin/env python
"""How often `vlafuzz bisect` names the right one of 16 checkpoints, and how often it is certain and wrong.

By the same code as on the command line, in the controls of a shipped corpus; only the outcomes are made up, of policies
that pass with known probabilities. A random checkpoint loses 20 or 10 points, and those after it as much (`20 points`,
`10 points`), or 5 points more each (`growing`); or two random ones lose 15 points each (`twice`), or 30 points get lost
little by little from a random one on (`gradual`). The last three are no single step, so that it is wrong to be certain.
Working checkpoints are `independent` of the baseline and each other, or `related`, equal to the baseline in nine of ten
scenes.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from vlafuzz.common.assets import corpus_dir
from vlafuzz.common.statistics import wilson
from vlafuzz.failures.corpus.bisect import Bisection
from vlafuzz.failures.corpus.folder import read_corpus
from vlafuzz.failures.corpus.pairs import Probe, probes
from vlafuzz.failures.corpus.regress import Asked, Recorded
from vlafuzz.model import Outcome, Verdict

CORPUS = corpus_dir() / "mini-pick-up"
CHECKPOINTS, OWN = 16, 0.1
COURSES = ("20 points", "10 points", "growing", "gradual", "twice")
SINGLE = ("20 points", "10 points")
FRESH = 40_000  # the model of the outcomes was chosen with smaller seeds

Booleans = NDArray[np.bool_]
Draw = Callable[[np.random.Generator], tuple[list[Booleans], int]]
# Probability of passing by a number that is uniform over scenes, and its mean.
KINDS: dict[str, tuple[Callable[[NDArray[np.float64]], NDArray[np.floating]], float]] = {
    "the same in all scenes, 0.5": (lambda u: 0.5 + 0 * u, 0.5),
    "0.3 to 0.7": (lambda u: 0.3 + 0.4 * u, 0.5),
    "anything": (lambda u: u, 0.5),
    "0.05 or 0.95": (lambda u: np.where(u < 0.5, 0.95, 0.05), 0.5),
    "always or never, 0.5": (lambda u: (u < 0.5) * 1.0, 0.5),
    "always or never, 0.8": (lambda u: (u < 0.8) * 1.0, 0.8),
}


@dataclass
class Given:
    """A side whose outcomes are given, by the number of the control in ``Probe.what``."""

    name: str
    passes: Booleans

    def answers(self, asked: Sequence[Asked]) -> Iterator[Outcome]:
        return (
            Outcome(verdict=Verdict.PASSED if self.passes[int(probe.what)] else Verdict.FAILED) for probe, _ in asked
        )


def made_up(
    kind: str, losses: Sequence[float], scenes: int, rng: np.random.Generator, *, related: bool
) -> list[Booleans]:
    """Outcomes of the baseline and of checkpoints that lose so much of the pass rate."""
    rate, mean = KINDS[kind]
    first, rows = rng.random(scenes), list[Booleans]()
    for loss in (0.0, *losses):
        own = rng.random(scenes) < (OWN if related and rows else 1.0)
        passing = rate(np.where(own, rng.random(scenes), first)) if rows else rate(first)
        rows.append(rng.random(scenes) < passing * (1 - loss / mean))
    return rows


def course(name: str, rng: np.random.Generator) -> tuple[list[float], int]:
    """The loss of every checkpoint, and the first one that has any."""
    first, second = sorted(map(int, rng.choice(CHECKPOINTS, 2, replace=False)))
    if name == "gradual":
        first //= 2
    at = np.arange(CHECKPOINTS)
    losses = {
        "20 points": np.full(CHECKPOINTS, 0.2),
        "10 points": np.full(CHECKPOINTS, 0.1),
        "growing": np.minimum(0.2 + 0.05 * (at - first), 0.45),
        "twice": np.where(at >= second, 0.3, 0.15),
        "gradual": 0.3 * (at - first + 1) / (CHECKPOINTS - first),
    }[name]
    return [float(loss) for loss in np.where(at >= first, losses, 0.0)], first


def search(rows: Sequence[Booleans], scenes: Sequence[Probe]) -> Bisection:
    numbered = [replace(probe, what=str(n), passed=bool(rows[0][n])) for n, probe in enumerate(scenes)]
    sides = {str(number): Given(str(number), row) for number, row in enumerate(rows[1:])}
    return Bisection(numbered, list(sides), lambda name: nullcontext(sides[name]), Recorded("baseline")).search()


def simulate(label: str, draw: Draw, seeds: range, *, single: bool) -> tuple[str, Counter[str]]:
    """One line of the table, and its counts.

    Args:
        single: whether the loss comes in one step.
    """
    scenes = [probe for probe in probes(read_corpus(CORPUS)) if probe.group == "control"]
    counts: Counter[str] = Counter()
    rollouts: list[int] = []
    for seed in seeds:
        rows, broken = draw(np.random.default_rng([seed, *label.encode()]))
        result = search(rows, scenes)
        counts["alarm"] += result.alarm
        counts["right"] += result.named == str(broken)
        counts["certain"] += result.certain
        counts["certain, wrong"] += result.certain and not (single and result.named == str(broken))
        counts["in the set"] += str(broken) in result.likely
        rollouts.append(sum(result.ran))
    shares = "".join(f"{share(counts[name], len(seeds)):>22}" for name in COLUMNS)
    return f"{label:52}{shares}{np.median(rollouts):>10.0f}", counts


COLUMNS = ("alarm", "right", "certain", "certain, wrong", "in the set")


def share(count: int, of: int) -> str:
    low, high = wilson(count, of)
    return f"{count / of:.1%} ({low:.1%}-{high:.1%})"


def draws() -> Iterator[tuple[str, str, Draw]]:
    """What is simulated, with its course and name."""

    def draw(rng: np.random.Generator, *, kind: str, name: str, related: bool) -> tuple[list[Booleans], int]:
        losses, first = course(name, rng)
        return made_up(kind, losses, 200, rng, related=related), first

    for name in COURSES:
        for kind in KINDS:
            for related in (False, True):
                label = f"{kind}, {'related' if related else 'independent'}, {name}"
                yield name, label, partial(draw, kind=kind, name=name, related=related)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--simulations", type=int, default=200, help="of each kind")
    parser.add_argument(
        "--seed", type=int, default=FRESH, help=f"of the first one; those below {FRESH} chose the model"
    )
    parser.add_argument("--only", default="", help="kinds whose names contain this")
    options = parser.parse_args()
    print(f"{'':52}{''.join(f'{name:>22}' for name in COLUMNS)}{'rollouts':>10}")
    seeds = range(options.seed, options.seed + options.simulations)
    totals: dict[str, Counter[str]] = {}
    for name, label, draw in draws():
        if options.only in label:
            line, counts = simulate(label, draw, seeds, single=name in SINGLE)
            totals.setdefault(name, Counter()).update(counts + Counter({"of": len(seeds)}))
            print(line, flush=True)
    for name, counts in totals.items():
        shares = "".join(f"{share(counts[column], counts['of']):>22}" for column in COLUMNS)
        print(f"{f'all: {name}':52}{shares}")


if __name__ == "__main__":
    main()
