#!/usr/bin/env python
"""What strategies find where it is known what there is: planted failures in closed form, no physics.

Regions of several shapes hold a share of the randomly generated scenes, found by sampling. No strategy knows
them. Each gets the same budget of rollouts in batches of 16, several times. A failure is a distinct scene, a
cell what vlafuzz.scoring.cell says. Medians over the seeds with 95 % bootstrap intervals. Times says how
many times those of random, as ratio of medians; A12 how often a run finds more cells than one of random
(Vargha and Delaney 2000), ties counted half; behind how many runs found fewer cells than random did with the
same seed.

With --long one long run a strategy instead: does a proposal cost as much at the end as at the beginning?
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vlafuzz.objects import load_catalogue
from vlafuzz.scoring import score
from vlafuzz.search.base import Strategy
from vlafuzz.search.registry import STRATEGIES
from vlafuzz.sim.toy import Region, Toy, among, band, near
from vlafuzz.space import SearchSpace, load_operators

BATCH = 16
SAMPLES = 20_000  # scenes by which a region's share is found: 200 of them in a region of 1 %
GOAL, SURE = 3.0, 0.9  # times random's cells, and A12
SIGNALS = ("smooth", "flat", "noise")
FOUND = ("cells", "failures")
COUNTED = ("behind", "invalid", "duplicates")
REGIONS = {
    "box of 4 genes": Region(
        (
            near("targets.0.x", -0.10, 0.32),
            near("targets.0.y", 0.12, 0.50),
            near("light.intensity", -2.0, 8.6),
            near("camera.roll", 2.0, 10.0),
        )
    ),
    "box of 3 genes": Region(
        (
            near("targets.0.x", 0.05, 0.32),
            near("targets.0.yaw", 90.0, 360.0, period=360.0),
            near("camera.pitch", -2.5, 10.0),
        )
    ),
    "slab": Region(
        (
            band(
                {"targets.0.x": 3.1, "targets.0.y": 2.0, "light.intensity": 0.116, "camera.yaw": 0.1},
                centre=1.0,
            ),
        )
    ),
    "three operators": Region(
        (
            near("light.intensity", -4.3, 8.6),
            near("camera.distance", 0.05, 0.05),
            near("confounders", 3.0, 3.0),
        )
    ),
    "three objects": Region(
        (
            among("targets.0.object", load_catalogue().graspable()[3:6]),
            near("light.intensity", 4.3, 8.6),
            near("camera.yaw", 5.0, 10.0),
        )
    ),
}


@dataclass
class Tally:
    """What a run came to."""

    failures: int = 0
    cells: int = 0
    invalid: int = 0
    duplicates: int = 0


def play(strategy: Strategy, toy: Toy, space: SearchSpace, budget: int) -> Tally:
    """A campaign without a store: known scenes and invalid ones cost nothing."""
    tally, known, failing, cells, spent = Tally(), {}, set(), set(), 0
    while spent < budget:
        proposals = strategy.ask(min(BATCH, budget - spent))
        scenes = [space.decode(proposal.genome) for proposal in proposals]
        scores = []
        for scene in scenes:
            tally.duplicates += scene.digest in known
            if scene.digest not in known:
                (outcome,) = toy.evaluate([scene])
                spent += len(outcome.rollouts)
                tally.invalid += not outcome.rollouts
                known[scene.digest] = score(scene, outcome, space)
            scores.append(known[scene.digest])
            if scores[-1].failed:
                failing.add(scene.digest)
                cells.add(scores[-1].cell)
        strategy.tell(proposals, scores)
    tally.failures, tally.cells = len(failing), len(cells)
    return tally


def interval(draws: Sequence[float]) -> list[float]:
    return [float(np.quantile(draws, share)) for share in (0.025, 0.975)]


def summarise(runs: dict[str, list[Tally]]) -> list[dict[str, Any]]:
    rng, repeats = np.random.default_rng(0), len(runs["random"])
    picks = rng.integers(repeats, size=(2, 2000, repeats))  # runs of different strategies are independent
    rows = []
    for name, tallies in runs.items():
        row: dict[str, Any] = {"strategy": name}
        row |= {key: float(np.median([asdict(run)[key] for run in tallies])) for key in asdict(Tally())}
        for key in FOUND:
            found, base = (np.array([asdict(run)[key] for run in each]) for each in (tallies, runs["random"]))
            medians, bases = (
                np.median(each[pick], axis=1) for each, pick in zip((found, base), picks, strict=True)
            )
            row[f"{key}_interval"] = interval(medians)
            row[f"{key}_times"] = row[key] / max(float(np.median(base)), 0.5)
            row[f"{key}_times_interval"] = interval(medians / np.maximum(bases, 0.5))
            row[f"{key}_runs"] = found.tolist()
        cells, base = (np.array([run.cells for run in each]) for each in (tallies, runs["random"]))
        row["behind"] = int((cells < base).sum())
        row["a12"] = float(((cells[:, None] > base) + 0.5 * (cells[:, None] == base)).mean())
        reached = row["cells_times"] >= GOAL and row["a12"] >= SURE
        rows.append(row | {"goal_reached": None if name == "random" else bool(reached)})
    return rows


def compare(options: argparse.Namespace, space: SearchSpace) -> list[dict[str, Any]]:
    scenes = [space.sample(np.random.default_rng([options.seed, 1, index])) for index in range(SAMPLES)]
    report = []
    for shape, planted in REGIONS.items():
        region = planted.calibrated(scenes, options.share)
        for signal in options.signals:
            toy = Toy(region, space.catalogue, min_distance=space.operators.min_distance, signal=signal)
            runs = {
                name: [
                    play(
                        STRATEGIES[name](space, options.seed + seed, options.budget),
                        toy,
                        space,
                        options.budget,
                    )
                    for seed in range(options.repeats)
                ]
                for name in ["random", *options.strategies]
            }
            rows = summarise(runs)
            report.append({"region": shape, "signal": signal, "width": region.width, "rows": rows})
            if not options.json:
                show(report[-1])
    return report


def show(part: dict[str, Any]) -> None:
    print(f"\n{part['region']}, {part['signal']}")
    found = "".join(f"{key:>9}{'95 %':>11}{'times':>7}{'95 %':>10}" for key in FOUND)
    print(f"{'':27}{found}{'A12':>6}" + "".join(f"{head:>11}" for head in COUNTED))
    for row in part["rows"]:
        line = f"{row['strategy']:27}"
        for key in FOUND:
            low, high = (
                f"{row[f'{key}{of}_interval'][0]:.0f}-{row[f'{key}{of}_interval'][1]:.0f}"
                for of in ("", "_times")
            )
            line += f"{row[key]:9.0f}{low:>11}{row[f'{key}_times']:7.1f}{high:>10}"
        line += f"{row['a12']:6.2f}" + "".join(f"{row[head]:11.0f}" for head in COUNTED)
        print(line + ("   MISSED" if row["goal_reached"] is False else ""), flush=True)


def endure(options: argparse.Namespace, space: SearchSpace) -> list[dict[str, Any]]:
    """One run of many evaluations a strategy: what ask and tell cost a proposal, and memory."""
    scenes = [space.sample(np.random.default_rng([options.seed, 1, index])) for index in range(2000)]
    region = REGIONS["box of 4 genes"].calibrated(scenes, options.share)
    toy = Toy(region, space.catalogue, min_distance=space.operators.min_distance)
    report = []
    for name in ["random", *options.strategies]:
        strategy, spent, memory = STRATEGIES[name](space, options.seed, options.long), [], []
        while sum(count for count, _ in spent) < options.long:
            began = time.process_time()
            proposals = strategy.ask(BATCH)
            asked = time.process_time() - began
            pairs = [
                (scene, toy.evaluate([scene])[0]) for scene in (space.decode(p.genome) for p in proposals)
            ]
            scores = [score(scene, outcome, space) for scene, outcome in pairs]
            began = time.process_time()
            strategy.tell(proposals, scores)
            spent.append((len(proposals), asked + time.process_time() - began))
            memory.append(int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 2**20)
        batches = 1000 // BATCH
        first, last = (
            [1e3 * seconds / count for count, seconds in part] for part in (spent[:batches], spent[-batches:])
        )
        row = {"strategy": name, "evaluations": options.long, "ms_first": float(np.mean(first))}
        row |= {"ms_last": float(np.mean(last)), "mib_grown": memory[-1] - memory[batches]}
        report.append(row)
        if not options.json:
            print(f"{name:27}{row['ms_first']:8.2f} ms a proposal in the first thousand", end="")
            print(f"{row['ms_last']:8.2f} in the last, {row['mib_grown']:.1f} MiB more", flush=True)
    return report


def main() -> None:
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    parser.add_argument("--task", default="pick-up")
    parser.add_argument(
        "--strategies", nargs="+", default=["surrogate", "nsga2", "feedback"], choices=list(STRATEGIES)
    )
    parser.add_argument("--signals", nargs="+", default=list(SIGNALS), choices=SIGNALS)
    parser.add_argument("--share", type=float, default=0.01, help="of random scenes that fail")
    parser.add_argument("--budget", type=int, default=300, help="rollouts")
    parser.add_argument("--repeats", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--long", type=int, metavar="N", help="one run of N evaluations instead")
    parser.add_argument("--json", action="store_true", help="print one JSON array instead")
    options = parser.parse_args()
    space = SearchSpace(load_operators(), load_catalogue(), options.task)
    report = endure(options, space) if options.long else compare(options, space)
    if options.json:
        print(json.dumps(report, indent=2))


if __name__ == "__main__":
    main()
