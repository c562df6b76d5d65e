"""The files of a comparison: a page with plots, tables and test results; JSON, markdown and CSV."""

from __future__ import annotations

import json
import shlex
from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path

from vlafuzz.compare.comparison import Comparison
from vlafuzz.compare.plots import plot
from vlafuzz.compare.tables import NOTE, markdown, sentences, tables, write_runs
from vlafuzz.compare.verdicts import ALPHA, MEASURES, Pair
from vlafuzz.files import write_whole
from vlafuzz.report.page import render_sheet, write_page
from vlafuzz.report.view import Picture, Sheet, Table
from vlafuzz.text import Row, plural

_TITLES = {
    "curves.png": "Found over the budget",
    "figures.png": "Found with the whole budget",
}
_TESTS = (
    "Times: ratio of the means, with its 95 % bootstrap interval over pairs of runs. A12: how often a run "
    "has more of it than one of the other strategy; ties count half. p: Mann and Whitney, two-sided, after "
    "Holm's correction over the strategies."
)


def write_folder(compared: Comparison, folder: Path) -> list[str]:
    """Write a comparison into an existing folder; the names of the files.

    Raises:
        OSError: the folder cannot be written.
    """
    document = json.dumps(asdict(compared), indent=2, allow_nan=False)
    write_whole(folder / "compare.json", document + "\n")
    write_whole(folder / "compare.md", markdown(compared))
    write_runs(compared, folder / "runs.csv")
    plots = plot(compared, folder)
    write_page(folder / "compare.html", page(compared, {path.name: path.read_bytes() for path in plots}))
    return ["compare.html", *(path.name for path in plots), "compare.json", "compare.md", "runs.csv"]


def page(compared: Comparison, plots: Mapping[str, bytes]) -> str:
    """HTML that needs no other file.

    Args:
        plots: PNG by the name of the file.
    """
    names = [standing.strategy for standing in compared.standings]
    runs = f"{plural(compared.repeats, 'run')} of each, {compared.budget} rollouts each"
    store = shlex.quote(compared.store)
    sheet = Sheet(
        title=f"{compared.policy} on {compared.task}: strategies compared",
        source=compared.store,
        headline=f"{', '.join(names)}: {runs}, with the same seeds.",
        conclusions=tuple(sentences(compared)),
        pictures=tuple(Picture(_TITLES[name], png, _described(name, names)) for name, png in plots.items()),
        tables=(*_tables(compared), *_tests(compared)),
        todo=(
            (
                "The failures themselves, on a page:",
                f"vlafuzz report {store} --out {_beside(compared.store)}",
            ),
        ),
    )
    return render_sheet(sheet)


def _tables(compared: Comparison) -> list[Table]:
    first, *others = tables(compared).items()
    titled = [
        Table(first[0], first[1], f"{NOTE[0].upper()}{NOTE[1:]}."),
        *(Table(title, rows) for title, rows in others),
    ]
    return [replace(table, title=f"{table.title[0].upper()}{table.title[1:]}") for table in titled]


def _tests(compared: Comparison) -> list[Table]:
    rows = [_row(pair) for pair in compared.against]
    return [Table(f"Against {compared.reference}", rows, _TESTS)] if rows else []


def _row(pair: Pair) -> Row:
    says = {measure.name: measure.says for measure in MEASURES}
    return {
        "figure": says[pair.measure],
        "strategy": pair.strategy,
        "times": "–" if pair.ratio is None else f"{pair.ratio:.2g}",
        "interval": "–" if pair.low is None or pair.high is None else f"{pair.low:.2g}–{pair.high:.2g}",
        "A12": f"{pair.a12:.2f}",
        "p": f"{pair.p_holm:.2g}",
        "shown": _shown(pair),
    }


def _shown(pair: Pair) -> str:
    if not pair.tells:
        return "too few repeats"
    return ("more" if pair.a12 > 0.5 else "fewer") if pair.p_holm <= ALPHA else "no difference"


def _described(name: str, strategies: list[str]) -> str:
    return f"{_TITLES[name]}, of {', '.join(strategies)}. The tables below have the numbers."


def _beside(store: str) -> str:
    return shlex.quote(str(Path(store).with_suffix(".html")))
