"""Plots of a comparison, as PNG."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from vlafuzz.lab.compare.comparison import Comparison
from vlafuzz.lab.plots import COLOURS, coloured, panels, save

_DASHES = ("-", "--", "-.", ":")  # with markers, curves can be told apart in greyscale
_MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*")
_BOXES = {
    "causes": "distinct certified causes",
    "causes_per_100": "causes per 100 rollouts, triage included",
    "failures": "distinct failing scenes",
    "probability_width": "width of the failure probability's interval",
    "cells": "distinct cells (a diagnostic)",
    "cid": "CID, less is better (a diagnostic)",
}


def plot(compared: Comparison, folder: Path) -> list[Path]:
    """Draw curves over the budget and box plots of the main figures; the files."""
    about = f"{compared.task}, {compared.policy}"
    repeats = f"{compared.repeats} runs a strategy" if compared.repeats > 1 else "one run a strategy"
    figures = {
        folder / "curves.png": _curves(compared, f"{about}: median and middle half of {repeats}"),
        folder / "figures.png": _boxes(
            compared, f"{about}: {compared.budget} rollouts, {repeats} (dots), their median and middle half (box)"
        ),
    }
    for path, figure in figures.items():
        save(figure, path, columns=4)
    return list(figures)


def _curves(compared: Comparison, title: str) -> Any:
    drawn = list(dict.fromkeys(curve.what for curve in compared.curves))
    figure, every = panels(title, len(drawn), len(drawn), (11, 4.4))
    looks = list(coloured([standing.strategy for standing in compared.standings], COLOURS).items())
    for axes, what in zip(every, drawn, strict=True):
        for number, (strategy, colour) in enumerate(looks):
            (curve,) = (one for one in compared.curves if (one.strategy, one.what) == (strategy, what))
            axes.fill_between(curve.rollouts, curve.low, curve.high, color=colour, alpha=0.13, linewidth=0)
            axes.plot(
                curve.rollouts, curve.median, label=strategy, color=colour, linewidth=1.8, markersize=4,
                linestyle=_DASHES[number % len(_DASHES)], marker=_MARKERS[number % len(_MARKERS)],
                markevery=max(1, len(curve.rollouts) // 8), clip_on=False,
            )  # fmt: skip
        limit, of = (compared.budget, "search")
        if what == "causes":
            limit, of = compared.triage_rollouts, "triage"
        axes.set(xlabel=f"rollouts of {of}", ylabel=_BOXES[what])
        axes.set(xlim=(0, limit), ylim=(0, max(1.0, axes.get_ylim()[1])))
    return figure


def _boxes(compared: Comparison, title: str) -> Any:
    colours = coloured([standing.strategy for standing in compared.standings], COLOURS)
    by_figure = {figure: {name: _values(compared, name, figure) for name in colours} for figure in _BOXES}
    boxes = {figure: values for figure, values in by_figure.items() if any(values.values())}
    height = 0.9 + -(-len(boxes) // 2) * (0.5 + 0.42 * max(3, len(colours)))
    figure, every = panels(title, len(boxes), 2, (11, height), sharey=True)
    for axes, (name, values) in zip(every, boxes.items(), strict=True):
        _boxes_of(axes, values, colours)
        axes.set(xlabel=_BOXES[name])
        axes.set_yticks(range(1, len(colours) + 1), list(colours))
        if not any(map(any, values.values())):
            axes.set(xlim=(0, 1))
    every[0].invert_yaxis()
    return figure


def _boxes_of(axes: Any, values: Mapping[str, Sequence[float]], colours: Mapping[str, str]) -> None:
    """A box per strategy with a dot per run: with few runs, a box alone would suggest too much."""
    for row, (name, runs) in enumerate(values.items(), start=1):
        if not runs:
            continue
        low, middle, high = np.percentile(runs, [25, 50, 75])
        axes.plot([min(runs), max(runs)], [row, row], color="#777777", linewidth=1)
        axes.barh(row, high - low, left=low, height=0.55, color="white", edgecolor="#777777", zorder=2)
        axes.plot([middle, middle], [row - 0.275, row + 0.275], color="black", linewidth=1.8, zorder=3)
        offsets = [0.12 * ((index % 3) - 1) for index in range(len(runs))]
        axes.scatter(runs, [row + offset for offset in offsets], s=14, color=colours[name], alpha=0.8, zorder=4)


def _values(compared: Comparison, strategy: str, name: str) -> list[float]:
    values = [run[name] for run in compared.runs if run["strategy"] == strategy]
    return [value for value in values if value is not None]
