"""A comparison as tables: for a terminal, markdown and CSV."""

from __future__ import annotations

import csv
from dataclasses import asdict, fields
from pathlib import Path

from vlafuzz.compare.comparison import SPREAD, Comparison, Spread, Standing
from vlafuzz.compare.evidence import Evidence
from vlafuzz.text import Row, count_of, markdown_table, percent

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
    return {
        f"found: {shared}": _rows(compared, _FOUND),
        f"all repeats together: {compared.union_cells} cells": together,
        **({"of the failures that the expert tried, triaged": triaged} if _triaged(compared) else {}),
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


def write_runs(compared: Comparison, path: Path) -> None:
    """Write a CSV file with one row per run."""
    rows = [asdict(run) for run in compared.runs]
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, fieldnames=list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


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


def _triaged(compared: Comparison) -> bool:
    return any(standing.evidence for standing in compared.standings)


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
