"""The page of a comparison: its plots, its tables and what its tests say."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from pathlib import Path

from vlafuzz.cli.compared import NOTE, sentences, tables
from vlafuzz.cli.output import Row
from vlafuzz.compare.compare import Comparison
from vlafuzz.compare.verdicts import ALPHA, MEASURES, Pair
from vlafuzz.report.page import render_sheet
from vlafuzz.report.sheet import Picture, Sheet, Table
from vlafuzz.report.words import plural

_TITLES = {
    "curves.png": "Found over the budget",
    "figures.png": "Found with the whole budget",
}
_TESTS = (
    "Times: ratio of the means, with its 95 % bootstrap interval over pairs of runs. A12: how often a run "
    "has more of it than one of the other strategy; ties count half. p: Mann and Whitney, two-sided, after "
    "Holm's correction over the strategies."
)


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
    made = [
        Table(first[0], first[1], f"{NOTE[0].upper()}{NOTE[1:]}."),
        *(Table(title, rows) for title, rows in others),
    ]
    return [Table(f"{each.title[0].upper()}{each.title[1:]}", each.rows, each.says) for each in made]


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
