"""A sheet: plots, tables and sentences on one page, as values without HTML."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Picture:
    """A PNG; ``says`` is the alternative text."""

    title: str
    png: bytes
    says: str


@dataclass(frozen=True)
class Table:
    """Rows with the same keys, which are the column heads; the first column names the row."""

    title: str
    rows: Sequence[Mapping[str, object]]
    says: str = ""

    @property
    def columns(self) -> Mapping[str, bool]:
        """Column heads, and whether the column holds numbers."""
        return {head: all(_is_number(row[head]) for row in self.rows) for head in self.rows[0]}


def _is_number(value: object) -> bool:
    return str(value).startswith(tuple("–0123456789"))


@dataclass(frozen=True, kw_only=True)
class Sheet:
    """The page.

    Attributes:
        source: the store or folder.
        headline: the subject, in a sentence.
        conclusions: in sentences.
        todo: next steps, each a sentence and the command.
    """

    title: str
    source: str
    headline: str
    conclusions: tuple[str, ...]
    pictures: tuple[Picture, ...]
    tables: tuple[Table, ...]
    todo: tuple[tuple[str, str], ...] = ()
