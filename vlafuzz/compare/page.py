"""A comparison as tables for a terminal, and as files: HTML with plots, JSON, markdown and CSV."""

import json
import shlex
from collections.abc import Mapping
from dataclasses import asdict, fields
from itertools import chain, repeat
from pathlib import Path

from vlafuzz.compare.comparison import SPREAD, Comparison, Spread, Standing
from vlafuzz.compare.plots import plot
from vlafuzz.compare.samples import Evidence
from vlafuzz.compare.verdicts import ALPHA, MEASURES, Pair
from vlafuzz.files import write_whole
from vlafuzz.report.page import render_sheet, write_page
from vlafuzz.report.view import Picture, Sheet, Table
from vlafuzz.text import Row, count_of, csv_table, markdown_table, percent, plural

_FOUND = {
    "failures": "failures",
    "cells": "cells",
    "coverage": "of all cells",
    "cid": "CID",
    "qd_score": "QD-score",
    "sparseness": "sparseness",
    "severity": "severity",
    "first_failure": "to 1st failure",
    "tenth_failure": "to 10th",
}
_COST = {
    "rollouts": "rollouts",
    "valid_share": "valid share",
    "rejected": "rejected",
    "seconds": "seconds",
    "rollout_seconds": "in rollouts",
    "search_seconds": "search",
    "search_share": "search share",
    "store_seconds": "store",
    "store_share": "store share",
}
_EVIDENCE = ("confirmed", "witnessed", "minimal", "distinct signatures")
_SHARES = ("coverage", "valid_share", "search_share", "store_share")
NOTE = (
    "median (middle half) over the repeats; CID: mean distance from all failures to the nearest one found, "
    "lower is better; to 1st, to 10th: rollouts; search: seconds in ask and tell, also as share of the wall "
    "time; solvable, confirmed: with the 95 % interval, which takes into account that failures of one run "
    "resemble each other"
)


def tables(compared: Comparison) -> dict[str, list[Row]]:
    """The rows of every table, by title."""
    shared = f"{compared.task}, {compared.policy}, {compared.budget} rollouts, {compared.repeats} repeats"
    together = [
        {
            "strategy": standing.strategy,
            "failures": standing.failures,
            "cells": standing.cells,
            "of all cells": percent(standing.coverage),
            "found by no other": standing.only,
            "solvable": _solvable(standing),
        }
        for standing in compared.standings
    ]
    triaged = [_evidence(standing) for standing in compared.standings]
    any_triaged = any(standing.evidence for standing in compared.standings)
    return {
        f"found: {shared}": _rows(compared, _FOUND),
        f"all repeats together: {compared.union_cells} cells": together,
        **({"of the failures that the expert tried, triaged": triaged} if any_triaged else {}),
        "cost": _rows(compared, _COST),
    }


def sentences(compared: Comparison) -> list[str]:
    """The test results for distinct cells and failures, by strategy."""
    return [
        f"{pair.strategy}: {pair.verdict}"
        for standing in compared.standings
        for pair in compared.against
        if pair.strategy == standing.strategy and pair.measure in ("cells", "failures")
    ]


def markdown(compared: Comparison) -> str:
    """The tables and sentences as markdown."""
    parts = [f"**{title}**\n\n{markdown_table(rows)}" for title, rows in tables(compared).items()]
    tests = "\n".join(f"- {sentence}" for sentence in sentences(compared))
    return "\n\n".join([*parts, NOTE, *([tests] if tests else [])]) + "\n"


def csv_rows(compared: Comparison) -> list[Row]:
    """One row of unrounded numbers per strategy."""
    return [_csv_row(standing) for standing in compared.standings]


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
    if value is None:
        return "–"
    if name in _SHARES:
        return percent(value)
    return f"{value:.0f}" if value >= 100 or value == int(value) else f"{value:.3g}"


def _solvable(standing: Standing) -> str:
    sample = standing.solvable
    return "–" if sample is None else count_of(sample.solved, sample.of, sample.low, sample.high)


def _evidence(standing: Standing) -> Row:
    evidence = standing.evidence
    if evidence is None:
        return {"strategy": standing.strategy} | dict.fromkeys(_EVIDENCE, "–")
    confirmed = count_of(evidence.confirmed, evidence.triaged, evidence.low, evidence.high)
    signatures = f"{evidence.signatures} of {evidence.triaged} triaged"
    values = (confirmed, evidence.witnessed, evidence.minimal, signatures)
    return {"strategy": standing.strategy} | dict(zip(_EVIDENCE, values, strict=True))


def _csv_row(standing: Standing) -> Row:
    row: Row = {"strategy": standing.strategy}
    for name in SPREAD:
        row |= {f"{name}_{part}": getattr(standing.figures[name], part) for part in ("median", "low", "high")}
    together = {name: getattr(standing, name) for name in ("failures", "cells", "coverage", "only")}
    row |= {f"all_{name}": value for name, value in together.items()}
    parts = ("solved", "of", "low", "high")
    row |= {f"solvable_{part}": getattr(standing.solvable, part, None) for part in parts}
    return row | {
        f"evidence_{part.name}": getattr(standing.evidence, part.name, None) for part in fields(Evidence)
    }


_TITLES = {"curves.png": "Found over the budget", "figures.png": "Found with the whole budget"}
_TESTS = (
    "Times, difference: of the means over pairs of runs with the same seed, each with its own 95 % interval. "
    "More in, fewer in: numbers of these pairs. p: Wilcoxon's signed-rank test of the pairs, two-sided, with "
    "Holm's correction for all {tests} tests: every strategy in every figure."
)


def write_folder(compared: Comparison, folder: Path) -> list[str]:
    """Write a comparison into an existing folder; the names of the files.

    Raises:
        OSError: the folder cannot be written.
    """
    document = json.dumps(asdict(compared), indent=2, allow_nan=False)
    write_whole(folder / "compare.json", document + "\n")
    write_whole(folder / "compare.md", markdown(compared))
    write_whole(folder / "runs.csv", csv_table([asdict(run) for run in compared.runs]))
    plots = plot(compared, folder)
    write_page(folder / "compare.html", page(compared, {path.name: path.read_bytes() for path in plots}))
    return ["compare.html", *(path.name for path in plots), "compare.json", "compare.md", "runs.csv"]


def page(compared: Comparison, plots: Mapping[str, bytes]) -> str:
    """HTML that needs no other file; ``plots`` are PNG by the name of the file."""
    names = ", ".join(standing.strategy for standing in compared.standings)
    runs = f"{plural(compared.repeats, 'run')} of each, {compared.budget} rollouts each"
    report = ["vlafuzz", "report", compared.store, "--out", str(Path(compared.store).with_suffix(".html"))]
    tests = [_row(pair) for pair in compared.against]
    sheet = Sheet(
        title=f"{compared.policy} on {compared.task}: strategies compared",
        source=compared.store,
        headline=f"{names}: {runs}, with the same seeds.",
        conclusions=tuple(sentences(compared)),
        pictures=tuple(
            Picture(title, plots[name], f"{title}, of {names}. The tables below have the numbers.")
            for name, title in _TITLES.items()
        ),
        tables=(
            *_tables(compared),
            *(
                [Table(f"Against {compared.reference}", tests, _TESTS.format(tests=len(tests)))]
                if tests
                else []
            ),
        ),
        todo=(("The failures themselves, on a page:", shlex.join(report)),),
    )
    return render_sheet(sheet)


def _tables(compared: Comparison) -> list[Table]:
    notes = chain([f"{NOTE[0].upper()}{NOTE[1:]}."], repeat(""))
    titled = zip(tables(compared).items(), notes, strict=False)
    return [Table(f"{title[0].upper()}{title[1:]}", rows, note) for (title, rows), note in titled]


def _row(pair: Pair) -> Row:
    says = {measure.name: measure.says for measure in MEASURES}
    return {
        "figure": says[pair.measure],
        "strategy": pair.strategy,
        "times": str(pair.ratio or "–"),
        "difference": str(pair.difference or "–"),
        "more in": pair.test.more,
        "fewer in": pair.test.fewer,
        "p": f"{pair.p_holm:.2g}",
        "shown": _difference(pair),
    }


def _difference(pair: Pair) -> str:
    if not pair.tells:
        return "too few repeats"
    return ("more" if pair.test.effect > 0 else "fewer") if pair.p_holm <= ALPHA else "no difference"
