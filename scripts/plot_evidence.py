#!/usr/bin/env python3
"""The charts of the pages on evidence, from the figures in scripts/evidence.yaml."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import yaml

from vlafuzz.common.statistics import wilson

mpl.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.axes import Axes

HERE = Path(__file__).parent
OUT = HERE.parent / "docs" / "pictures"
Row = tuple[float, float, float]  # a figure with the ends of its 95 % interval


def faults(worlds: dict[str, dict[str, Row]]) -> None:
    """How many times as many planted faults `causes` finds, by how rare failures are."""
    figure, axes = plt.subplots(figsize=(7, 3))
    kinds = ((-0.12, "attribution", "identified, same attribution"), (0.12, "certified", "certified, with triage"))
    for offset, kind, label in kinds:
        rows = {index + offset: row[kind] for index, row in enumerate(worlds.values()) if kind in row}
        draw(axes, list(rows), list(rows.values()), label)
    axes.axvline(1, color="grey", linewidth=1)
    axes.set(xlim=(0.9, 3), xlabel="planted faults of the strategy causes, times those of random scenes")
    label_rows(axes, [f"{world} worlds" for world in worlds])
    axes.set_ylim(len(worlds) - 0.6, -0.4)
    axes.legend(fontsize=8, loc="lower center", bbox_to_anchor=(0.5, 1), ncols=2)
    figure.tight_layout()
    figure.savefig(OUT / "evidence-faults.png", dpi=110)


def shares(name: str, figures: dict[str, list[float]], told: str, ends: tuple[float, float]) -> None:
    """Shares with their intervals, in percent, one below the other."""
    rows = [percent(values) for values in figures.values()]
    figure, axes = plt.subplots(figsize=(8, 1 + 0.28 * len(rows)))
    draw(axes, list(range(len(rows))), rows, "")
    axes.set(xlim=ends, xlabel=told)
    axes.grid(axis="x", alpha=0.4)
    label_rows(axes, list(figures))
    figure.tight_layout()
    figure.savefig(OUT / f"evidence-{name}.png", dpi=110)


def percent(values: list[float]) -> Row:
    if len(values) == 2:
        low, high = wilson(*values)
        return 100 * values[0] / values[1], 100 * low, 100 * high
    middle, low, high = values
    return middle, low, high


def draw(axes: Axes, places: list[float], rows: list[Row], label: str) -> None:
    middle, low, high = (list(column) for column in zip(*rows, strict=True))
    spread = [
        [m - one for m, one in zip(middle, low, strict=True)],
        [one - m for m, one in zip(middle, high, strict=True)],
    ]
    axes.errorbar(middle, places, xerr=spread, fmt="o", capsize=3, label=label)


def label_rows(axes: Axes, names: list[str]) -> None:
    """One name a row, the first on top."""
    axes.set_yticks(range(len(names)), names)
    axes.invert_yaxis()


if __name__ == "__main__":
    data = yaml.safe_load((HERE / "evidence.yaml").read_text(encoding="utf-8"))
    faults(data["faults"])
    shares("holds", data["holds"], "statements that hold, % (95 % interval)", (70, 101))
    shares("libero", data["libero"], "initial states with a defect, %", (-1, 101))
    shares("real", data["real"], "episodes that fail in unchanged scenes, % (95 % interval)", (0, 7))
