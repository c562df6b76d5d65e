"""Shared parts of plots. matplotlib is imported when one is drawn."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from vlafuzz.common.files import replacing

# Okabe, Ito 2008: distinguishable with any colour vision.
COLOURS = ("#000000", "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#8C6D31")


def panels(title: str, number: int, columns: int, size: tuple[float, float], **options: Any) -> tuple[Any, list[Any]]:
    """A figure with panels side by side, without spines at the top and at the right.

    Args:
        size: inches, of the whole figure.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained")
    every = list(figure.subplots(-(-number // columns), columns, squeeze=False, **options).flat)
    for axes in every[number:]:
        axes.remove()
    for axes in every[:number]:
        plain(axes)
    figure.suptitle(title, fontsize=11)
    return figure, every[:number]


def plain(axes: Any, grid: str = "both") -> None:
    """Leave only pale grid lines, along one axis or both, and the spines at the left and the bottom."""
    axes.grid(visible=False)
    axes.grid(axis=grid, color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


def save(figure: Any, path: Path, columns: int = 6) -> None:
    """Write a figure with one legend for all panels, below them."""
    labelled: dict[str, Any] = {}
    for axes in figure.axes:
        handles, labels = axes.get_legend_handles_labels()
        labelled |= zip(labels, handles, strict=True)
    if labelled:
        place = {"loc": "outside lower center", "ncols": min(columns, len(labelled))}
        figure.legend(labelled.values(), labelled.keys(), **place, frameon=False, fontsize=8)
    with replacing(path) as unfinished:
        figure.savefig(unfinished, dpi=150, format="png")


def coloured(names: Sequence[str], colours: Sequence[str] = COLOURS[1:]) -> dict[str, str]:
    """A colour for each name."""
    return {name: colours[number % len(colours)] for number, name in enumerate(dict.fromkeys(names))}
