"""A comparison as tables for a terminal, and as files: HTML with plots, JSON, markdown and CSV."""

import json
import shlex
from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path

from vlafuzz.common.files import write_whole
from vlafuzz.common.text import Row, csv_table, interval, markdown_table, percent, plural
from vlafuzz.lab.compare.comparison import SPREAD, Comparison, Spread, Standing
from vlafuzz.lab.compare.plots import plot
from vlafuzz.lab.compare.verdicts import ALPHA, MEASURES, Pair
from vlafuzz.report.page import render_sheet, write_page
from vlafuzz.report.view import Picture, Table, View

_JUDGED = {
    "causes": "causes",
    "triage_rollouts": "rollouts of triage",
    "causes_per_100": "causes per 100 rollouts",
    "failures": "failures",
}
_COST = {
    "rollouts": "rollouts",
    "first_failure": "to 1st failure",
    "tenth_failure": "to 10th",
    "valid_share": "valid share",
    "rejected": "rejected",
    "seconds": "seconds",
    "rollout_seconds": "in rollouts",
    "search_share": "search",
    "store_share": "store",
}
_DIAGNOSTICS = {
    "cells": "cells",
    "coverage": "of all cells",
    "cid": "CID",
    "qd_score": "QD-score",
    "sparseness": "sparseness",
    "severity": "severity",
}
_SHARES = ("coverage", "valid_share", "search_share", "store_share")
_CAUSES = (
    "Means over the runs, with 95% intervals. Causes: distinct causes certified in a run by triage of its "
    "failures, with at most {limit} more rollouts of the policy; per 100 rollouts: of search and triage "
    "together. "
)
_FAILURES = (
    "Means over the runs, with 95% intervals. Nothing was triaged (--triage-rollouts 0), so that strategies "
    "are judged by failures, of which many may have one cause. "
)
_PROBABILITY = (
    "Failure probability: of random scenes, as one run tells it (mean of the estimates and of the bounds of "
    "their 95% intervals); – where a strategy does not estimate it."
)
_TOGETHER = (
    "Confirmed: findings that mostly fail in their neighbourhood; certified: of these, those with a minimal "
    "scene; distinct: causes that differ in operators, directions or the lost stage."
)
_COMMONEST = 20  # causes that are listed
_RUNS = f"Runs in which a cause was certified, of {{runs}} a strategy; the {_COMMONEST} commonest causes."
_SPENT = (
    "Median (middle half) over the runs, search alone. To 1st, to 10th: rollouts until then; in rollouts: "
    "added up over all processes; search, store: shares of the wall time in the strategy's ask and tell and "
    "in the store."
)
_NOT_CAUSES = (
    "Median (middle half) over the runs. These describe where failing scenes lie and do not count causes, of "
    "which one can fill many cells: a cell is a lost stage, the operators far from nominal and the place of "
    "the target ({cells} in all runs together); CID is the mean distance from all cells' failures to the "
    "nearest one of the run, lower is better; QD-score adds up the quality of the best failure of each cell; "
    "sparseness is the mean distance to the nearest other failure."
)


def tables(compared: Comparison) -> list[Table]:
    """What strategies are judged by, what it took, and diagnostics."""
    limit = compared.triage_rollouts
    judged = _CAUSES.format(limit=limit) if limit else _FAILURES
    shared = f"{compared.task}, {compared.policy}, {compared.budget} rollouts, {compared.repeats} repeats"
    diagnostics, causes = _NOT_CAUSES.format(cells=compared.union_cells), _causes(compared)
    return [
        Table(
            f"{'Causes' if limit else 'Failures'}: {shared}",
            [_judged(standing, triaged=bool(limit)) for standing in compared.standings],
            judged + _PROBABILITY,
        ),
        *([Table("Triage, all repeats together", _together(compared), _TOGETHER)] if limit else []),
        *([Table("Causes by strategy", causes, _RUNS.format(runs=compared.repeats))] if causes else []),
        Table("Cost", _rows(compared, _COST), _SPENT),
        Table("Diagnostics", _rows(compared, _DIAGNOSTICS), diagnostics),
    ]


def sentences(compared: Comparison) -> list[str]:
    """The test results by strategy, causes first, and where triage was too short to tell."""
    verdicts = [
        f"{pair.strategy}: {pair.verdict}"
        for standing in compared.standings
        for pair in compared.against
        if pair.strategy == standing.strategy
    ]
    if short := [run for run in compared.runs if run["triage_rollouts"] and not run["triaged"]]:
        runs = f"in {len(short)} of {plural(len(compared.runs), 'run')}"
        few = f"{compared.triage_rollouts} rollouts are too few to triage one failure"
        verdicts.append(f"{runs} {few}: give more --triage-rollouts")
    return verdicts


def markdown(compared: Comparison) -> str:
    """The tables and sentences as markdown."""
    parts = [f"**{table.title}**\n\n{markdown_table(table.rows)}\n\n{table.says}" for table in tables(compared)]
    tests = "\n".join(f"- {sentence}" for sentence in sentences(compared))
    return "\n\n".join([parts[0], *([tests] if tests else []), *parts[1:]]) + "\n"


def csv_rows(compared: Comparison) -> list[Row]:
    """One row of unrounded numbers per strategy."""
    return [_csv_row(standing) for standing in compared.standings]


def _csv_row(standing: Standing) -> Row:
    row: Row = {"strategy": standing.strategy}
    for name, estimate in [*standing.means.items(), ("probability", standing.probability)]:
        row |= {f"{name}_{part}": getattr(estimate, part, None) for part in ("value", "low", "high")}
    row["all_causes"] = len(standing.triage.causes) if standing.triage else None
    row["all_causes_only"] = standing.triage.only if standing.triage else None
    names = ("triaged", "confirmed", "certified")
    row |= {f"all_{name}": getattr(standing.triage, name, None) for name in names}
    for name in SPREAD:
        row |= {f"{name}_{part}": getattr(standing.figures[name], part) for part in ("median", "low", "high")}
    return row


def _judged(standing: Standing, *, triaged: bool) -> Row:
    row: Row = {"strategy": standing.strategy}
    for name, title in _JUDGED.items():
        if triaged or name == "failures":
            mean = standing.means[name]
            row[title] = mean and (f"{mean.value:.3g}" if mean.low is None else str(mean))
    tells = standing.probability
    shown = tells and f"{percent(tells.value)} ({interval(tells.low or 0.0, tells.high or 0.0)})"
    return {title: "–" if value is None else value for title, value in row.items()} | {
        "failure probability": shown or "–"
    }


def _together(compared: Comparison) -> list[Row]:
    return [
        {
            "strategy": standing.strategy,
            "triaged": triage.triaged,
            "confirmed": triage.confirmed,
            "certified": triage.certified,
            "distinct": len(triage.causes),
            "found by no other": triage.only,
        }
        for standing in compared.standings
        if (triage := standing.triage)
    ]


def _causes(compared: Comparison) -> list[Row]:
    """By cause, in how many runs of each strategy it was certified; the commonest first."""
    runs = {standing.strategy: standing.triage.causes for standing in compared.standings if standing.triage}
    total = sum((Counter(causes) for causes in runs.values()), Counter[str]())
    rows = []
    for signature, _ in total.most_common(_COMMONEST):
        _, lost, cause = signature.split("|", 2)
        row = {"cause": cause, "loses": lost}
        rows.append(row | {strategy: causes.get(signature, 0) for strategy, causes in runs.items()})
    return rows


def _rows(compared: Comparison, columns: dict[str, str]) -> list[Row]:
    return [
        {"strategy": standing.strategy}
        | {title: _shown(standing.figures[name], name) for name, title in columns.items()}
        for standing in compared.standings
    ]


def _shown(spread: Spread, name: str) -> str:
    low, middle, high = (_number(value, name) for value in (spread.low, spread.median, spread.high))
    to = " to " if "–" in (low, high) else "–"
    return middle if low == middle == high else f"{middle} ({low}{to}{high})"


def _number(value: float | None, name: str) -> str:
    if value is None or name in _SHARES:
        return percent(value)
    return f"{value:.0f}" if value >= 100 or value == int(value) else f"{value:.3g}"


_TITLES = {"curves.png": "Found over the budget", "figures.png": "Found with the whole budget"}
_TESTS = (
    "Times, difference: of the means over pairs of runs with the same seed, each with its own 95 % interval. "
    "More in, fewer in: numbers of these pairs. p: Wilcoxon's signed-rank test of the pairs, two-sided, with "
    "Holm's correction for all {tests} tests."
)


def write_folder(compared: Comparison, folder: Path) -> list[str]:
    """Write a comparison into an existing folder; the names of the files.

    Raises:
        OSError: the folder cannot be written.
    """
    document = json.dumps(asdict(compared), indent=2, allow_nan=False)
    write_whole(folder / "compare.json", document + "\n")
    write_whole(folder / "compare.md", markdown(compared))
    write_whole(folder / "runs.csv", csv_table(compared.runs))
    plots = plot(compared, folder)
    write_page(folder / "compare.html", _page(compared, {path.name: path.read_bytes() for path in plots}))
    return ["compare.html", *(path.name for path in plots), "compare.json", "compare.md", "runs.csv"]


def _page(compared: Comparison, plots: Mapping[str, bytes]) -> str:
    """HTML that needs no other file; ``plots`` are PNG by the name of the file."""
    names = ", ".join(standing.strategy for standing in compared.standings)
    runs = f"{plural(compared.repeats, 'run')} of each, {compared.budget} rollouts each"
    report = ["vlafuzz", "report", compared.store, "--out", str(Path(compared.store).with_suffix(".html"))]
    tests = [_tested(pair) for pair in compared.against]
    first, *others = tables(compared)
    against = Table(f"Against {compared.reference}", tests, _TESTS.format(tests=len(tests)))
    sheet = View(
        title=f"{compared.policy} on {compared.task}: strategies compared",
        source=compared.store,
        headline=f"{names}: {runs}, with the same seeds.",
        conclusions=tuple(sentences(compared)),
        pictures=tuple(
            Picture(title, plots[name], f"{title}, of {names}. The tables below have the numbers.")
            for name, title in _TITLES.items()
        ),
        tables=(first, *([against] if tests else []), *others),
        todo=(("The failures themselves, on a page:", shlex.join(report)),),
    )
    return render_sheet(sheet)


def _tested(pair: Pair) -> Row:
    measure, shown = MEASURES[pair.measure], "too few repeats"
    if pair.tells:
        larger = measure.more if pair.test.effect > 0 else measure.fewer
        shown = larger if pair.p_holm <= ALPHA else "no difference"
    return {
        "figure": measure.says,
        "strategy": pair.strategy,
        "times": str(pair.ratio or "–"),
        "difference": str(pair.difference or "–"),
        "more in": pair.test.more,
        "fewer in": pair.test.fewer,
        "p": f"{pair.p_holm:.2g}",
        "shown": shown,
    }
