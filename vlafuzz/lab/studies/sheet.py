"""The results of a study as a sheet: tables, notes and a plot."""

from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

from vlafuzz.common.statistics import holm
from vlafuzz.common.text import markdown_table
from vlafuzz.report.view import Table

BESIDE = (
    "The paper's figures are of other policies on other robots in another simulator: they are shown "
    "for reference and cannot be compared."
)


@dataclass(frozen=True)
class Sheet:
    """The tables of a study, with notes, how the paper's protocol differs, and a plot for a PNG file."""

    title: str
    tables: Sequence[Table]
    notes: Sequence[str]
    differs: str
    draw: Callable[[Path], None]

    def markdown(self) -> str:
        """The sheet as markdown."""
        parts = [f"# {self.title}"]
        for table in self.tables:
            parts += [f"**{table.title}**", markdown_table(table.rows)]
        return "\n\n".join([*parts, *self.notes, self.deviation]) + "\n"

    @property
    def deviation(self) -> str:
        """How the paper's protocol differs, as a sentence."""
        return f"What differs from the paper: {self.differs}"


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

    @property
    def gaps(self) -> list[str]:
        """A note on runs that were left out, if any."""
        return [f"Left out: {'; '.join(self.left_out)}."] if self.left_out else []

    @abstractmethod
    def sheet(self) -> Sheet:
        """The result as tables, notes and a plot."""


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
