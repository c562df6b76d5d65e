"""Runs of strategies on cases, compared with random: ratios, A12 and p-values, as rows, tables and JSON."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import product
from multiprocessing import get_context
from pathlib import Path
from statistics import mean, median
from typing import Any, Protocol

from rich.progress import track

from vlafuzz.statistics import a12, holm, mann_whitney, ratio, ratio_interval

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


def rows(figures_of: dict[str, dict[str, list[dict[str, float]]]], measure: str) -> list[Row]:
    """One per case and strategy, compared with random; p-values are corrected over all rows (Holm)."""
    table = []
    for case, runs in figures_of.items():
        base = [figures[measure] for figures in runs[RANDOM]]
        for name, played in runs.items():
            values = [figures[measure] for figures in played]
            interval = ratio_interval(values, base)
            row: Row = {"case": case, "strategy": name, "measure": measure, "runs": values}
            row |= {"median": median(values), "mean": mean(values), "ratio": ratio(values, base)}
            row |= {"low": interval.low if interval else None, "high": interval.high if interval else None}
            table.append(row | {"a12": a12(values, base), "p": mann_whitney(values, base)})
    tested = [row for row in table if row["strategy"] != RANDOM]
    for row, corrected in zip(tested, holm([row["p"] for row in tested]), strict=True):
        row["p_holm"] = corrected
    return table


def show(table: Sequence[Row]) -> None:
    """Print the rows as tables."""
    case = None
    for row in table:
        if row["case"] != case:
            case = row["case"]
            print(f"\n{case} ({row['measure']})\n{'':29}{'median':>8}{'mean':>8}", end="")
            print(f"{'ratio (95 %)':>21}{'A12':>6}{'p':>9}")
        p = f"{row['p_holm']:.1g}" if "p_holm" in row else ""
        line = f"{row['strategy']:29}{row['median']:8.1f}{row['mean']:8.1f}{times(row):>21}"
        print(line + f"{row['a12']:6.2f}{p:>9}")


def times(row: Row) -> str:
    """A ratio with its interval."""
    if row["ratio"] is None:
        return "–"
    between = f"{row['low']:.2f}-{row['high']:.2f}" if row["low"] is not None else "no bound"
    return f"{row['ratio']:.2f} ({between})"


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
