"""Sheet: a page of pictures and tables, as of a comparison."""

from dataclasses import dataclass

from vlafuzz.report.view import Table


@dataclass(frozen=True)
class Picture:
    """A PNG; ``says`` is the alternative text."""

    title: str
    png: bytes
    says: str


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
