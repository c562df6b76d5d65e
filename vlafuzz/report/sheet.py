"""Sheet: pictures, tables and sentences on one page. Nothing here knows HTML, or what they are of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Picture:
    """A PNG; ``says`` tells what is in it to those who do not see it."""

    title: str
    png: bytes
    says: str


@dataclass(frozen=True)
class Table:
    """Rows that have the same keys, which are the heads of the columns; the first column names the row."""

    title: str
    rows: Sequence[Mapping[str, object]]
    says: str = ""

    @property
    def columns(self) -> Mapping[str, bool]:
        """Heads of the columns, and whether there are numbers below."""
        return {head: all(_is_number(row[head]) for row in self.rows) for head in self.rows[0]}


def _is_number(value: object) -> bool:
    return str(value).startswith(tuple("–0123456789"))


@dataclass(frozen=True)
class Sheet:
    """The page.

    Attributes:
        source: where it is from.
        headline: what it is about, in a sentence.
        said: what comes of it, in sentences.
        todo: what can be done next, each a sentence and the command.
    """

    title: str
    source: str
    headline: str
    said: tuple[str, ...]
    pictures: tuple[Picture, ...]
    tables: tuple[Table, ...]
    todo: tuple[tuple[str, str], ...] = ()
