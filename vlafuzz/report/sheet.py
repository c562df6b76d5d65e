"""Tables, and pages of tables and pictures, as values."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Table:
    """Rows with the same keys, which are the column heads; the first column names the row."""

    title: str
    rows: Sequence[Mapping[str, object]]
    says: str = ""

    @property
    def columns(self) -> Mapping[str, bool]:
        """Column heads, and whether the column holds numbers."""
        numbers = tuple("–0123456789")
        return {head: all(str(row[head]).startswith(numbers) for row in self.rows) for head in self.rows[0]}


@dataclass(frozen=True)
class Picture:
    """A PNG; ``says`` is the alternative text."""

    title: str
    png: bytes
    says: str


@dataclass(frozen=True, kw_only=True)
class Sheet:
    """A page of conclusions, pictures and tables, as of a comparison.

    Attributes:
        source: the files that it is about.
        headline: the result in a sentence.
    """

    title: str
    source: str
    headline: str
    conclusions: tuple[str, ...] = ()
    pictures: tuple[Picture, ...] = ()
    tables: tuple[Table, ...] = ()
