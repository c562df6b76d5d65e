"""Shared parts of the studies' plots. matplotlib is imported when one is drawn."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from vlafuzz.common.files import replacing
from vlafuzz.common.statistics import Share
from vlafuzz.lab.compare.plots import plain

# Okabe, Ito 2008: distinguishable with any colour vision.
COLOURS = ("#0072B2", "#E69F00", "#009E73", "#56B4E9", "#D55E00")
MARK = {"marker": "D", "color": "#000000", "edgecolor": "#FFFFFF", "s": 24, "zorder": 3, "clip_on": False}


class Series(NamedTuple):
    """Shares of one colour and label, one per place; None where there is none."""

    label: str
    shares: Sequence[Share | None]
    colour: str
    alpha: float = 1.0


def panels(
    title: str, names: Sequence[str], label: str, *, columns: int = 4, width: float = 3.2
) -> tuple[Any, list[Any]]:
    """A figure with named panels side by side; ``label`` is that of the y axes, from 0 to 1."""
    from matplotlib.figure import Figure

    columns = min(columns, len(names))
    rows = -(-len(names) // columns)
    figure = Figure(figsize=(max(width * columns + 0.8, 5), 2.9 * rows + 0.9), layout="constrained")
    every = list(figure.subplots(rows, columns, sharey=True, squeeze=False).flat)
    for axes in every[len(names) :]:
        axes.remove()
    for axes, name in zip(every, names, strict=False):
        axes.set_title(name, fontsize=10)
        axes.set_ylim(0, 1)
        plain(axes, "y")
        axes.tick_params(labelsize=8)
    for axes in every[: len(names) : columns]:
        axes.set_ylabel(label)
    figure.suptitle(title, fontsize=11)
    return figure, every[: len(names)]


def bars(axes: Any, places: Sequence[str], every: Sequence[Series]) -> list[list[float]]:
    """Draw bars with intervals, the series side by side at each place; the x of each series' bars."""
    width, positions = 0.8 / max(len(every), 1), []
    for number, series in enumerate(every):
        centres = [place + (number - (len(every) - 1) / 2) * width for place in range(len(places))]
        known = [(x, share) for x, share in zip(centres, series.shares, strict=True) if share and share.of]
        xs, shares = [x for x, _ in known], [share for _, share in known]
        heights = [share.share for share in shares]
        axes.bar(xs, heights, width * 0.92, color=series.colour, alpha=series.alpha, label=series.label)
        axes.errorbar(xs, heights, _ends(shares), fmt="none", ecolor="#777777", elinewidth=1, capsize=2)
        positions.append(centres)
    axes.set_xticks(range(len(places)), places)
    return positions


def line(axes: Any, xs: Sequence[float], series: Series) -> None:
    """Draw points with intervals, joined by lines."""
    shares = [share for share in series.shares if share]
    if not shares:
        return  # matplotlib cannot lay out axes with empty lines only
    axes.errorbar(
        xs, [share.share for share in shares], _ends(shares),
        color=series.colour, label=series.label, marker="o", markersize=4, linewidth=1.2, elinewidth=0.8,
        capsize=2, clip_on=False,
    )  # fmt: skip


def save(figure: Any, path: Path) -> None:
    """Write a figure with one legend for all panels, below them."""
    labelled: dict[str, Any] = {}
    for axes in figure.axes:
        handles, labels = axes.get_legend_handles_labels()
        labelled |= zip(labels, handles, strict=True)
    if labelled:
        place = {"loc": "outside lower center", "ncols": min(6, len(labelled))}
        figure.legend(labelled.values(), labelled.keys(), **place, frameon=False, fontsize=8)
    with replacing(path) as unfinished:
        figure.savefig(unfinished, dpi=150, format="png")


def coloured(names: Sequence[str]) -> dict[str, str]:
    """A colour for each name."""
    return {name: COLOURS[number % len(COLOURS)] for number, name in enumerate(dict.fromkeys(names))}


def _ends(shares: Sequence[Share]) -> list[list[float]]:
    below = [max(0.0, share.share - share.low) for share in shares]
    return [below, [max(0.0, share.high - share.share) for share in shares]]
