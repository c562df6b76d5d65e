"""Plots of a comparison, as PNG. matplotlib is imported when one is drawn."""

import math
from collections.abc import Mapping, Sequence
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np

from vlafuzz.common.files import replacing
from vlafuzz.lab.compare.comparison import Comparison
from vlafuzz.lab.compare.figures import Curve

# Okabe, Ito 2008: distinguishable with any colour vision, and by dashes and markers in greyscale.
_COLOURS = ("#000000", "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#8C6D31")
_DASHES = ("-", "--", "-.", ":")
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
    figures = {folder / "curves.png": _curves(compared), folder / "figures.png": _boxes(compared)}
    for path, figure in figures.items():
        with replacing(path) as unfinished:
            figure.savefig(unfinished, dpi=150, format="png")
    return list(figures)


def _curves(compared: Comparison) -> Any:
    from matplotlib.figure import Figure

    drawn = dict.fromkeys(curve.what for curve in compared.curves)
    figure = Figure(figsize=(11, 4.4), layout="constrained")
    styles = _styles(compared)
    for axes, what in zip(figure.subplots(1, len(drawn)), drawn, strict=True):
        for curve in compared.curves:
            if curve.what == what:
                _draw(axes, curve, styles[curve.strategy])
        limit = compared.triage_rollouts if what == "causes" else compared.budget
        axes.set(xlabel=f"rollouts of {'triage' if what == 'causes' else 'search'}", ylabel=_BOXES[what])
        axes.set(xlim=(0, limit), ylim=(0, max(1.0, axes.get_ylim()[1])))
        plain(axes)
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(4, len(labels)), frameon=False)
    figure.suptitle(
        f"{compared.task}, {compared.policy}: median and middle half of {_repeats(compared)}", fontsize=11
    )
    return figure


def _draw(axes: Any, curve: Curve, style: Mapping[str, str]) -> None:
    axes.fill_between(curve.rollouts, curve.low, curve.high, color=style["color"], alpha=0.13, linewidth=0)
    every = max(1, len(curve.rollouts) // 8)
    markers = {"markersize": 4, "markevery": every, "clip_on": False}
    axes.plot(curve.rollouts, curve.median, label=curve.strategy, linewidth=1.8, **style, **markers)


def _boxes(compared: Comparison) -> Any:
    from matplotlib.figure import Figure

    names = [standing.strategy for standing in compared.standings]
    boxes = {
        figure: values
        for figure in _BOXES
        if any(values := [_values(compared, name, figure) for name in names])
    }
    rows = math.ceil(len(boxes) / 2)
    figure = Figure(figsize=(11, 0.9 + rows * (0.5 + 0.42 * max(3, len(names)))), layout="constrained")
    grid = figure.subplots(rows, 2, sharey=True, squeeze=False)
    for axes in list(grid.flat)[len(boxes) :]:
        axes.set_visible(False)
    for axes, (figure_name, values) in zip(grid.flat, boxes.items(), strict=False):
        _boxes_of(axes, values, [_styles(compared)[name]["color"] for name in names])
        axes.set(xlabel=_BOXES[figure_name], xlim=None if any(map(any, values)) else (0, 1))
        axes.set_yticks(range(1, len(names) + 1), names)
        plain(axes)
    grid[0, 0].invert_yaxis()
    caption = f"{compared.budget} rollouts, {_repeats(compared)} (dots), their median and middle half (box)"
    figure.suptitle(f"{compared.task}, {compared.policy}: {caption}", fontsize=11)
    return figure


def _boxes_of(axes: Any, values: Sequence[Sequence[float]], colours: Sequence[str]) -> None:
    """A box per strategy with a dot per run: with few runs, a box alone would suggest too much."""
    for row, (runs, colour) in enumerate(zip(values, colours, strict=True), start=1):
        if not runs:
            continue
        low, middle, high = np.percentile(runs, [25, 50, 75])
        axes.plot([min(runs), max(runs)], [row, row], color="#777777", linewidth=1)
        axes.barh(row, high - low, left=low, height=0.55, color="white", edgecolor="#777777", zorder=2)
        axes.plot([middle, middle], [row - 0.275, row + 0.275], color="black", linewidth=1.8, zorder=3)
        offsets = [0.12 * ((index % 3) - 1) for index in range(len(runs))]
        axes.scatter(runs, [row + offset for offset in offsets], s=14, color=colour, alpha=0.8, zorder=4)


def _values(compared: Comparison, strategy: str, name: str) -> list[float]:
    values = [getattr(run, name) for run in compared.runs if run.strategy == strategy]
    return [value for value in values if value is not None]


def _styles(compared: Comparison) -> dict[str, dict[str, str]]:
    looks = zip(compared.standings, cycle(_COLOURS), cycle(_DASHES), cycle(_MARKERS), strict=False)
    return {
        standing.strategy: {"color": colour, "linestyle": dashes, "marker": marker}
        for standing, colour, dashes, marker in looks
    }


def plain(axes: Any, grid: str = "both") -> None:
    """Leave only pale grid lines, along one axis or both, and the spines at the left and the bottom."""
    axes.grid(axis=grid, color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


def _repeats(compared: Comparison) -> str:
    return f"{compared.repeats} runs a strategy" if compared.repeats > 1 else "one run a strategy"
