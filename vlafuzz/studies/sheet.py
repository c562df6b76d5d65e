"""A study on paper: tables, and what to know about them."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from vlafuzz.text import Row, markdown_table

BESIDE = (
    "The paper's figures are of other policies on other robots in another simulator: they stand "
    "beside, they do not compare."
)


@dataclass(frozen=True)
class Table:
    """Rows that have the same keys."""

    title: str
    rows: Sequence[Row]


@dataclass(frozen=True)
class Sheet:
    """What a study says.

    Attributes:
        differs: from the paper's protocol, and why.
        draw: makes the plot, a PNG.
    """

    title: str
    tables: Sequence[Table]
    notes: Sequence[str]
    differs: str
    draw: Callable[[Path], None]

    def markdown(self) -> str:
        """To paste."""
        parts = [f"# {self.title}"]
        for table in self.tables:
            parts += [f"**{table.title}**", markdown_table(table.rows)]
        return "\n\n".join([*parts, *self.notes, self.deviation]) + "\n"

    @property
    def deviation(self) -> str:
        """What differs from the paper's protocol, as a sentence."""
        return f"What differs from the paper: {self.differs}"


@dataclass(frozen=True)
class StudyResult:
    """What a study found; each has more.

    Attributes:
        left_out: runs that had no scene, and why.
    """

    study: str
    policies: list[str]
    left_out: list[str]

    @property
    def title(self) -> str:
        """Of the sheet and its plot."""
        name = self.study.upper() if self.study.startswith("rq") else self.study.capitalize()
        return f"{name}: {', '.join(self.policies)}"

    @property
    def gaps(self) -> list[str]:
        """A note of what was left out, if anything."""
        return [f"Left out: {'; '.join(self.left_out)}."] if self.left_out else []

    @abstractmethod
    def sheet(self) -> Sheet:
        """It on paper."""


def chance(p: float | None, adjusted: float | None = None) -> str:
    """A p-value, and in parentheses what it is among as many tests."""
    if p is None:
        return "–"
    return f"{p:.3g}" + ("" if adjusted is None else f" ({adjusted:.3g})")
