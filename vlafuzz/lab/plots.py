"""The plot of a comparison or a study: estimates with their intervals, one below the other."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from vlafuzz.common.files import replacing

_DOT, _LINE, _CONTROL = "#0072B2", "#000000", "#D55E00"  # Okabe, Ito 2008: distinguishable with any colour vision


@dataclass(frozen=True)
class Line:
    """An estimate from ``low`` to ``high``, with the single values that it is of, and that of its control."""

    label: str
    value: float | None
    low: float | None
    high: float | None
    dots: Sequence[float] = ()
    control: float | None = None


def draw(path: Path, title: str, panels: Mapping[str, Sequence[Line]], most: float | None = None) -> None:
    """Write a PNG file with a panel for each name; ``most`` is the right end of all axes, by default their own.

    Raises:
        OSError: the file cannot be written.
    """
    from matplotlib.figure import Figure

    lines = [len(of_panel) for of_panel in panels.values()]
    size = (9, 1.2 + sum(0.6 + 0.3 * number for number in lines))
    figure = Figure(figsize=size, layout="constrained")
    figure.suptitle(title, fontsize=11)
    every = figure.subplots(len(panels), 1, squeeze=False, height_ratios=[number + 1 for number in lines])[:, 0]
    for axes, (name, of_panel) in zip(every, panels.items(), strict=True):
        for row, line in enumerate(of_panel):
            # Dots of runs with the same value lie beside each other.
            offsets = [0.12 * (number % 3 - 1) for number in range(len(line.dots))]
            axes.scatter(line.dots, [row + offset for offset in offsets], s=12, color=_DOT, alpha=0.7)
            if line.low is not None and line.high is not None:
                axes.plot([line.low, line.high], [row, row], color=_LINE, linewidth=1.2)
            if line.value is not None:
                axes.plot(line.value, row, "o", color=_LINE, markersize=5)
            if line.control is not None:
                axes.plot(line.control, row, "D", color=_CONTROL, markersize=5, markerfacecolor="none")
        axes.set_title(name, fontsize=10, loc="left")
        axes.set_yticks(range(len(of_panel)), [line.label for line in of_panel], fontsize=8)
        axes.set_ylim(len(of_panel) - 0.5, -0.5)
        axes.set_xlim(0, most)
        axes.grid(axis="x", color="#dddddd", linewidth=0.6)
        axes.set_axisbelow(True)
        axes.spines[["top", "right"]].set_visible(False)
    with replacing(path) as unfinished:
        figure.savefig(unfinished, dpi=150, format="png")
