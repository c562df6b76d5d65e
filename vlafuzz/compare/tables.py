"""A comparison as tables: for a terminal, markdown and CSV."""

from __future__ import annotations

import csv
from dataclasses import asdict, fields
from pathlib import Path

from vlafuzz.compare.comparison import SPREAD, Comparison, Spread, Standing
from vlafuzz.compare.evidence import Evidence
from vlafuzz.text import Row, markdown_table

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
_SHARES = ("coverage", "valid_share")
_SMALL_SHARES = ("search_share", "store_share")
NOTE = (
    "median (middle half) over the repeats; CID: mean distance from all failures to the nearest found, "
    "less is better; to 1st, to 10th: rollouts; search: seconds in ask and tell, as share of the wall time; "
    "solvable, confirmed: with the 95 % interval, in which failures of one run count as alike as they are"
)


def tables(compared: Comparison) -> dict[str, list[Row]]:
    """Rows by title."""
    shared = f"{compared.task}, {compared.policy}, {compared.budget} rollouts, {compared.repeats} repeats"
    together = [
        {
            "strategy": each.strategy,
            "failures": each.failures,
            "cells": each.cells,
            "of all cells": f"{each.coverage:.0%}" if each.coverage is not None else "–",
            "found by no other": each.only,
            "solvable": _solvable(each),
        }
        for each in compared.standings
    ]
    triaged = [_evidence(each) for each in compared.standings]
    return {
        f"found: {shared}": _rows(compared, _FOUND),
        f"all repeats together: {compared.union_cells} cells": together,
        **({"of the failures that the expert tried, triaged": triaged} if _triaged(compared) else {}),
        "cost": _rows(compared, _COST),
    }


def sentences(compared: Comparison) -> list[str]:
    """What the tests say of distinct cells and of failures, by strategy."""
    return [
        f"{pair.strategy}: {pair.verdict}"
        for standing in compared.standings
        for pair in compared.against
        if pair.strategy == standing.strategy and pair.measure in ("cells", "failures")
    ]


def markdown(compared: Comparison) -> str:
    """The tables and sentences as markdown."""
    parts = [f"**{title}**\n\n{markdown_table(rows)}" for title, rows in tables(compared).items()]
    said = "\n".join(f"- {sentence}" for sentence in sentences(compared))
    return "\n\n".join([*parts, NOTE, *([said] if said else [])]) + "\n"


def csv_rows(compared: Comparison) -> list[Row]:
    """A row a strategy: numbers, unrounded."""
    return [_csv_row(each) for each in compared.standings]


def write_runs(compared: Comparison, path: Path) -> None:
    """A row a run."""
    rows = [asdict(run) for run in compared.runs]
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, fieldnames=list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def _rows(compared: Comparison, columns: dict[str, str]) -> list[Row]:
    return [
        {"strategy": each.strategy}
        | {says: _shown(each.figures[name], name) for name, says in columns.items()}
        for each in compared.standings
    ]


def _shown(spread: Spread, name: str) -> str:
    low, middle, high = (_number(value, name) for value in (spread.low, spread.median, spread.high))
    to = " to " if "–" in (low, high) else "–"
    return middle if low == middle == high else f"{middle} ({low}{to}{high})"


def _number(value: float | None, name: str) -> str:
    if value is None:
        return "–"
    if name in _SHARES:
        return f"{value:.0%}"
    if name in _SMALL_SHARES:
        return f"{value:.1%}"
    return f"{value:.0f}" if value >= 100 or value == int(value) else f"{value:.3g}"


def _solvable(each: Standing) -> str:
    found = each.solvable
    return "–" if found is None else f"{found.solved} of {found.of} ({found.low:.0%}–{found.high:.0%})"


def _triaged(compared: Comparison) -> bool:
    return any(each.evidence for each in compared.standings)


def _evidence(each: Standing) -> Row:
    found = each.evidence
    if found is None:
        return {"strategy": each.strategy} | dict.fromkeys(_EVIDENCE, "–")
    confirmed = f"{found.confirmed} of {found.triaged} ({found.low:.0%}–{found.high:.0%})"
    signatures = f"{found.signatures} of {found.triaged} triaged"
    values = (confirmed, found.witnessed, found.minimal, signatures)
    return {"strategy": each.strategy} | dict(zip(_EVIDENCE, values, strict=True))


def _csv_row(each: Standing) -> Row:
    row: Row = {"strategy": each.strategy}
    for name in SPREAD:
        row |= {f"{name}_{part}": getattr(each.figures[name], part) for part in ("median", "low", "high")}
    together = {name: getattr(each, name) for name in ("failures", "cells", "coverage", "only")}
    row |= {f"all_{name}": value for name, value in together.items()}
    parts = ("solved", "of", "low", "high")
    row |= {f"solvable_{part}": getattr(each.solvable, part, None) for part in parts}
    return row | {
        f"evidence_{part.name}": getattr(each.evidence, part.name, None) for part in fields(Evidence)
    }
