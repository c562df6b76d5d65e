"""Sheets: pages of conclusions, pictures and tables."""

from dataclasses import dataclass
from pathlib import Path

from vlafuzz import __version__
from vlafuzz.report.page import environment
from vlafuzz.report.tables import Table

TEMPLATE = Path(__file__).with_name("sheet.html.j2")


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


def render_sheet(sheet: Sheet) -> str:
    """A sheet as one HTML page without external resources."""
    return environment().from_string(TEMPLATE.read_text()).render(sheet=sheet, version=__version__, refresh=None)
