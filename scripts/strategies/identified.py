"""Faults identified: arms played on worlds with planted faults, at equal numbers of rollouts in total."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import product
from statistics import median
from typing import Any

from strategies.arms import ATTRIBUTION, RANDOM_TRIAGE, Setting, arms, splits_of
from strategies.faults import Density, world
from strategies.faulty import simulated
from strategies.results import Row, estimate, shown, side_by_side
from vlafuzz.common.statistics import holm, mean_estimate, mean_ratio, signed_rank

BASES = {"triage": RANDOM_TRIAGE, "attribution": ATTRIBUTION}
SIMULATOR = "simulator"
HEAD = "split identified (95 %) exact causes twice  precision (95 %) exact touched"
FAULTS = (1, 2, 4, 6, 8, 10)  # identified, whose rollouts are reported

Splits = Mapping[str, Mapping[str, float]]  # by case and arm


@dataclass(frozen=True)
class Played:
    """A run: its figures, and the rollouts after which one fault, two and so on were identified."""

    figures: Mapping[str, float]
    times: Sequence[int]


@dataclass(frozen=True)
class Job:
    """A world, and the settings in which each arm is played there.

    Attributes:
        policy: in the simulator; None without physics.
        ground: the worlds that it is reported with.
    """

    density: Density
    seed: int
    policy: str | None
    ground: str
    settings: Mapping[str, Sequence[Setting]]

    def play(self) -> dict[str, dict[Setting, Played]]:
        policy, known = self.policy, arms()
        here = simulated(self.density, self.seed, policy) if policy else world(self.density, self.seed)
        return {
            name: {
                (budget, split): Played(course.figures(budget), course.times(budget))
                for (budget, split), course in known[name](here, settings).items()
            }
            for name, settings in self.settings.items()
        }


def case(ground: str, budget: int) -> str:
    """The name of a case."""
    return f"{ground}, {budget} rollouts"


def settings(
    ground: str, names: Sequence[str], budgets: Sequence[int], splits: Sequence[float], tuned: Splits
) -> dict[str, list[Setting]]:
    """How each arm is played: with all splits where none is tuned."""

    def several(name: str, budget: int) -> Sequence[float]:
        known = tuned.get(case(ground, budget), {}).get(name)
        return splits_of(name, splits) if known is None else (known,)

    return {name: [(budget, split) for budget in budgets for split in several(name, budget)] for name in names}


def play(jobs: Sequence[Job], workers: int) -> dict[str, Any]:
    """All figures, with the split that is best for an arm and budget in the worlds of a ground.

    Returns:
        Rows by ground, budget and arm; and rollouts until so many faults are identified.
    """
    played = side_by_side(jobs, Job.play, workers)
    rows, speeds = [], []
    for ground in dict.fromkeys(job.ground for job in jobs):
        worlds = [runs for job, runs in zip(jobs, played, strict=True) if job.ground == ground]
        budgets = sorted({budget for runs in worlds[0].values() for budget, _ in runs})
        chosen = {key: _best(worlds, *key) for key in product(budgets, worlds[0])}
        runs = {key: [arms[key[1]][key[0], split] for arms in worlds] for key, split in chosen.items()}
        for (budget, name), split in chosen.items():
            bases = {label: runs.get((budget, base)) for label, base in BASES.items()}
            about = {"case": case(ground, budget), "ground": ground, "rollouts": budget}
            rows.append(about | {"arm": name, "split": split} | _row(runs[budget, name], bases))
        for name in worlds[0]:
            soonest = zip(*(runs[budget, name] for budget in budgets), strict=True)
            speeds.append({"ground": ground, "arm": name} | _speed(list(map(_soonest, soonest))))
    tests = [row[label] for row in rows for label in BASES if label in row]
    for test, corrected in zip(tests, holm([test["p"] for test in tests]), strict=True):
        test |= {"p_holm": corrected, "tests": len(tests)}
    return {"identified": rows, "rollouts to the k-th fault": speeds}


def _best(worlds: Sequence[Mapping[str, Mapping[Setting, Played]]], budget: int, name: str) -> float:
    """The split with which most faults are identified; of several, that which touches most."""

    def worth(split: float) -> tuple[float, float]:
        figures = [runs[name][budget, split].figures for runs in worlds]
        return sum(run["identified"] for run in figures), sum(run["touched"] for run in figures)

    return max((split for of, split in worlds[0][name] if of == budget), key=worth)


def _row(runs: Sequence[Played], bases: Mapping[str, Sequence[Played] | None]) -> Row:
    """The figures of an arm, compared with the bases; precision is the share of all causes reported."""

    def of(figure: str, played: Sequence[Played] = runs) -> list[float]:
        return [run.figures[figure] for run in played]

    row: Row = {"runs": of("identified"), "identified": estimate(mean_estimate(of("identified")))}
    row |= {name: _mean(of(name)) for name in ("exact", "reported", "right", "duplicates", "unplanted", "touched")}
    row["precision"] = _share(of("right"), of("reported"))
    row["exact precision"] = _share(of("rightly exact"), of("reported"))
    for label, base in bases.items():
        if base and base is not runs:
            paired = of("identified"), of("identified", base)
            row[label] = {"ratio": estimate(mean_ratio(*paired)), **asdict(signed_rank(*paired))}
    return row


def _share(part: Sequence[float], whole: Sequence[float]) -> Row | None:
    row = estimate(mean_ratio(part, whole))
    if row and row["high"] is not None:
        row["high"] = min(row["high"], 1.0)
    return row


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values)


def _soonest(runs: Sequence[Played]) -> list[float]:
    """Rollouts until so many faults are identified, with the best of the budgets for each number."""
    return [
        min((run.times[number - 1] for run in runs if len(run.times) >= number), default=math.inf) for number in FAULTS
    ]


def _speed(soonest: Sequence[Sequence[float]]) -> Row:
    """The median over worlds; None where fewer than half come so far."""
    medians = [median(times) for times in zip(*soonest, strict=True)]
    return {str(number): value if math.isfinite(value) else None for number, value in zip(FAULTS, medians, strict=True)}


def tuned(content: Mapping[str, Any]) -> Splits:
    """The splits of figures as ``play`` returns them."""
    splits: dict[str, dict[str, float]] = {}
    for row in content["identified"]:
        splits.setdefault(row["case"], {})[row["arm"]] = row["split"]
    return splits


def show(content: Mapping[str, Any]) -> None:
    """Print the figures as tables."""
    case = None
    for row in content["identified"]:
        if row["case"] != case:
            case = row["case"]
            print(f"\n{case}\n{'':23}{HEAD}", end="")
            print("".join(f"{'ratio to random + ' + label:>32}{'p':>8}" for label in BASES))
        _show_row(row)
    print(f"\nmedian rollouts until so many faults are identified\n{'':36}", end="")
    print("".join(f"{number:8}" for number in FAULTS))
    for speed in content["rollouts to the k-th fault"]:
        times = (speed[str(number)] for number in FAULTS)
        print(f"{speed['ground']:13}{speed['arm']:23}", end="")
        print("".join(f"{time:8.0f}" if time else f"{'–':>8}" for time in times))
    tests = {row[label]["tests"] for row in content["identified"] for label in BASES if label in row}
    print("\nexact: with the fault's operators; twice: causes that are about the fault of another one")
    for number in tests:
        print(f"p: Wilcoxon's signed-rank test over worlds, Holm's correction for {number} tests")


def _show_row(row: Row) -> None:
    exactly = row["exact precision"]
    print(f"{row['arm']:23}{row['split'] or '':>5}{shown(row['identified'], 1):>18}{row['exact']:6.1f}", end="")
    print(f"{row['reported']:7.1f}{row['duplicates']:6.1f}{shown(row['precision']):>18}", end="")
    print(f"{exactly['value'] if exactly else math.nan:6.2f}{row['touched']:8.1f}", end="")
    for test in (row.get(label) for label in BASES):
        print(f"{shown(test['ratio']):>32}{test['p_holm']:8.1g}" if test else " " * 40, end="")
    print()
