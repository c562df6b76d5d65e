"""The result of a study as a sheet: tables, notes and a plot of shares."""

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from vlafuzz.common.statistics import Share, holm
from vlafuzz.common.text import markdown_table
from vlafuzz.lab import plots
from vlafuzz.report.view import Table

BESIDE = (
    "The paper's figures are of other policies on other robots in another simulator: they are shown "
    "for reference and cannot be compared."
)
MARK = {"marker": "D", "color": "#000000", "edgecolor": "#FFFFFF", "s": 24, "zorder": 3, "clip_on": False}


@dataclass(frozen=True)
class StudyResult:
    """The result of a study, with the runs that had no scenes, and why; subclasses add rows."""

    study: str
    policies: list[str]
    left_out: list[str]

    @property
    def title(self) -> str:
        """The title of the sheet and the plot."""
        name = self.study.upper() if self.study.startswith("rq") else self.study.capitalize()
        return f"{name}: {', '.join(self.policies)}"

    @abstractmethod
    def sheet(self) -> tuple[list[Table], list[str]]:
        """The tables, and notes on them; see ``noted``."""

    @abstractmethod
    def draw(self, path: Path) -> None:
        """Write the plot, a PNG file."""

    def noted(self, differs: str, *notes: str) -> list[str]:
        """Notes, among them one on runs that were left out, and how the paper's protocol ``differs``."""
        gaps = [f"Left out: {'; '.join(self.left_out)}."] if self.left_out else []
        return [*notes, *gaps, f"What differs from the paper: {differs}"]

    def markdown(self) -> str:
        """The sheet as markdown."""
        tables, notes = self.sheet()
        shown = [f"**{table.title}**\n\n{markdown_table(table.rows)}" for table in tables]
        return "\n\n".join([f"# {self.title}", *shown, *notes]) + "\n"


@dataclass(frozen=True, kw_only=True)
class Tested:
    """A row with a p-value, ``adjusted`` for the number of tests; None where nothing was tested."""

    p: float | None
    adjusted: float | None = None


_Tested = TypeVar("_Tested", bound=Tested)


def adjusted(rows: Sequence[_Tested]) -> list[_Tested]:
    """The rows with their p-values corrected for how many there are, by Holm's method."""
    values = iter(holm([row.p for row in rows if row.p is not None]))
    return [row if row.p is None else replace(row, adjusted=next(values)) for row in rows]


def chance(p: float | None, adjusted: float | None = None) -> str:
    """A p-value, and in parentheses the value corrected for the number of tests."""
    if p is None:
        return "–"
    return f"{p:.3g}" + ("" if adjusted is None else f" ({adjusted:.3g})")


class Series(NamedTuple):
    """Shares of one colour and label, one per place; None where there is none."""

    label: str
    shares: Sequence[Share | None]
    colour: str
    alpha: float = 1.0


def share_panels(
    title: str, names: Sequence[str], label: str, *, columns: int = 4, width: float = 3.2
) -> tuple[Any, list[Any]]:
    """A figure with named panels side by side; ``label`` is that of the y axes, from 0 to 1."""
    columns = min(columns, len(names))
    size = (max(width * columns + 0.8, 5), 2.9 * -(-len(names) // columns) + 0.9)
    figure, every = plots.panels(title, len(names), columns, size, sharey=True)
    for axes, name in zip(every, names, strict=True):
        axes.set_title(name, fontsize=10)
        axes.set_ylim(0, 1)
        plots.plain(axes, "y")
        axes.tick_params(labelsize=8)
    for axes in every[::columns]:
        axes.set_ylabel(label)
    return figure, every


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


def _ends(shares: Sequence[Share]) -> list[list[float]]:
    below = [max(0.0, share.share - share.low) for share in shares]
    return [below, [max(0.0, share.high - share.share) for share in shares]]
