"""Runs of strategies on cases, compared with random: means, ratios and p-values, as rows, tables and JSON."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from itertools import product
from multiprocessing import get_context
from pathlib import Path
from statistics import median
from typing import Any, Protocol

from rich.progress import track

from vlafuzz.common.statistics import Estimate, holm, mean_estimate, mean_ratio, signed_rank

ONE_THREAD = {"OMP_NUM_THREADS": "1", "LP_NUM_THREADS": "0"}
RANDOM = "random"
Row = dict[str, Any]


class Case(Protocol):
    """A benchmark case; picklable."""

    @property
    def name(self) -> str: ...

    def play(self, strategy: str, seed: int, budget: int) -> dict[str, float]:
        """One run of a strategy; its figures by name."""


@dataclass(frozen=True)
class Job:
    case: Case
    strategy: str
    seed: int
    budget: int

    def play(self) -> dict[str, float]:
        return self.case.play(self.strategy, self.seed, self.budget)


def side_by_side(jobs: Sequence[Any], work: Callable[[Any], Any], workers: int) -> list[Any]:
    """The results of the jobs, in order, with a progress bar; every worker has one thread."""
    os.environ.update(ONE_THREAD)
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        return list(track(pool.map(work, jobs), total=len(jobs), description="runs", console=_stderr()))


def run(
    cases: Sequence[Case], strategies: Sequence[str], *, seeds: Iterable[int], budget: int, workers: int
) -> dict[str, dict[str, list[dict[str, float]]]]:
    """The figures of all runs in the order of the seeds, by case and strategy."""
    seeds = list(seeds)
    jobs = [Job(case, name, seed, budget) for case, seed, name in product(cases, seeds, strategies)]
    played = side_by_side(jobs, Job.play, workers)
    figures_of: dict[str, dict[str, list[dict[str, float]]]] = {
        case.name: {name: [] for name in strategies} for case in cases
    }
    for job, figures in zip(jobs, played, strict=True):
        figures_of[job.case.name][job.strategy].append(figures)
    return figures_of


def rows(figures_of: dict[str, dict[str, list[dict[str, float]]]], *measures: str) -> list[Row]:
    """One per measure, case and strategy, compared with random; p-values are corrected for all of them."""
    table = []
    for measure, (case, runs) in product(measures, figures_of.items()):
        base = [figures[measure] for figures in runs[RANDOM]]
        for name, played in runs.items():
            values = [figures[measure] for figures in played]
            row: Row = {"case": case, "strategy": name, "measure": measure, "runs": values}
            row |= {"median": median(values), "mean": estimate(mean_estimate(values))}
            if name != RANDOM:
                row |= {"ratio": estimate(mean_ratio(values, base)), **asdict(signed_rank(values, base))}
            table.append(row)
    tested = [row for row in table if "p" in row]
    for row, corrected in zip(tested, holm([row["p"] for row in tested]), strict=True):
        row |= {"p_holm": corrected, "tests": len(tested)}
    return table


def estimate(known: Estimate | None) -> Row | None:
    """As a JSON value."""
    return asdict(known) if known else None


def show(table: Sequence[Row]) -> None:
    """Print the rows as tables."""
    case = None
    for row in table:
        if row["case"] != case:
            case = row["case"]
            print(f"\n{case} ({row['measure']})\n{'':29}{'median':>8}{'mean (95 %)':>24}", end="")
            print(f"{'ratio (95 %)':>21}{'more':>6}{'fewer':>7}{'p':>9}")
        print(f"{row['strategy']:29}{row['median']:8.1f}{shown(row['mean'], 1):>24}", end="")
        if "p" in row:
            print(f"{shown(row['ratio']):>21}{row['more']:6}{row['fewer']:7}{row['p_holm']:9.1g}", end="")
        print()
    tests = max(row.get("tests", 0) for row in table)
    print(f"\nmore, fewer: pairs of runs; p: Wilcoxon's signed-rank test, Holm's correction for {tests} tests")


def shown(row: Row | None, digits: int = 2) -> str:
    """An estimate with its interval."""
    if row is None:
        return "–"
    low, high = row["low"], row["high"]
    between = "no bound" if low is None else f"{low:.{digits}f}-{high:.{digits}f}"
    return f"{row['value']:.{digits}f} ({between})"


def write(path: Path | None, content: dict[str, Any]) -> None:
    """Write JSON with lists of numbers on one line."""
    if path:
        path.parent.mkdir(parents=True, exist_ok=True)
        text = "\n".join(_lines(content, ""))
        path.write_text(text + "\n", encoding="utf-8")


def _lines(value: Any, indent: str) -> list[str]:
    """JSON in which numbers, texts and lists of these stay on one line."""
    if isinstance(value, dict) and any(isinstance(item, dict | list) for item in value.values()):
        parts = [(f"{json.dumps(key)}: ", item) for key, item in value.items()]
    elif isinstance(value, list) and any(isinstance(item, dict) for item in value):
        parts = [("", item) for item in value]
    else:
        return [json.dumps(_short(value))]
    opening, closing = "{}" if isinstance(value, dict) else "[]"
    lines = [opening]
    for number, (key, item) in enumerate(parts, start=1):
        first, *rest = _lines(item, indent + " ")
        comma = "," if number < len(parts) else ""
        lines += [f" {key}{first}", *(f" {line}" for line in rest)]
        lines[-1] += comma
    return [*lines, closing]


def _short(value: Any) -> Any:
    """Numbers with six significant digits."""
    if isinstance(value, float):
        return int(value) if value == int(value) else float(f"{value:.6g}")
    if isinstance(value, dict):
        return {key: _short(item) for key, item in value.items()}
    return [_short(item) for item in value] if isinstance(value, list | tuple) else value


def _stderr() -> Any:
    from rich.console import Console

    return Console(file=sys.stderr)
