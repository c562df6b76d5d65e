"""A plot of the faults identified by rollouts, a panel for each ground."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from strategies.arms import ATTRIBUTION, HUNTING
from strategies.results import Row

# Okabe, Ito 2008; other strategies are grey.
_COLOURS = ("#D55E00", "#0072B2", "#009E73", "#000000")
_MARKERS = ("o", "s", "^", "D")


def plot(rows: Sequence[Row], file: Path) -> None:
    """Means with their 95 % intervals, as PNG."""
    from matplotlib.figure import Figure

    grounds = list(dict.fromkeys(row["ground"] for row in rows))
    names = list(dict.fromkeys(row["arm"] for row in rows))
    figure = Figure(figsize=(4 * len(grounds), 4.6), layout="constrained")
    panels = figure.subplots(1, len(grounds), squeeze=False)[0]
    for axes, ground in zip(panels, grounds, strict=True):
        shown = [row for row in rows if row["ground"] == ground]
        for name in names:
            _draw(axes, [row for row in shown if row["arm"] == name], name)
        budgets = sorted({row["rollouts"] for row in shown})
        axes.set(xscale="log", xlabel="rollouts, search and triage", title=ground)
        axes.set_xticks(budgets, budgets)
        axes.minorticks_off()
        highest = max(row["identified"]["value"] for row in shown)
        axes.set_ylim(0, 1.3 * highest or 1)  # intervals of few worlds may be much higher
        axes.grid(color="#dddddd", linewidth=0.6)
    panels[0].set_ylabel("faults identified")
    handles, labels = panels[0].get_legend_handles_labels()
    once = dict(zip(labels, handles, strict=True))
    figure.legend(once.values(), once, loc="outside lower center", ncols=1 + len(grounds), frameon=False)
    figure.savefig(file, dpi=150)


def _draw(axes: Any, rows: Sequence[Row], name: str) -> None:
    main = [HUNTING, ATTRIBUTION, "random + shrinking", "random + triage"]
    style: dict[str, Any] = {"color": "#999999", "linewidth": 0.8, "zorder": 1, "label": "other strategies"}
    if name in main:
        place = main.index(name)
        style = {"color": _COLOURS[place], "marker": _MARKERS[place], "linewidth": 1.8, "zorder": 3}
    estimates = [row["identified"] for row in rows]
    values = [known["value"] for known in estimates]
    ends = [
        [max(known["value"] - known["low"], 0) if known["low"] is not None else 0 for known in estimates],
        [known["high"] - known["value"] if known["low"] is not None else 0 for known in estimates],
    ]
    budgets = [row["rollouts"] for row in rows]
    intervals = ends if name in main else None
    axes.errorbar(budgets, values, yerr=intervals, capsize=2, markersize=4, **{"label": name} | style)
