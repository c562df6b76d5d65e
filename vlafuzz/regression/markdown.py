"""A comparison as Markdown, for the summary of a job or a comment."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from vlafuzz.files import write_whole, writing
from vlafuzz.regression.corpus import Corpus
from vlafuzz.regression.regress import Comparison
from vlafuzz.regression.tables import difference, tables

SHOWN = 20  # rows of a table


def write_summary(comparison: Comparison, corpus: Corpus, path: Path, still: bytes | None) -> None:
    """Write atomically: the verdict, the tables, and a picture beside it with the same name.

    Args:
        still: JPEG of a scene that the policy broke.

    Raises:
        UsageError: the system refuses to write it.
    """
    picture = path.with_suffix(".jpg")
    with writing(path, hint="give --summary another place"):
        if still is not None:
            write_whole(picture, still)
        write_whole(path, _page(comparison, corpus, picture.name if still is not None else None))


def _page(comparison: Comparison, corpus: Corpus, picture: str | None) -> str:
    sign = "❌" if comparison.alarm else "✅" if comparison.tells else "❔"
    parts = [f"## {sign} {_cell(comparison.verdict)}", _cell(comparison.changes), difference(comparison)]
    if picture is not None:
        parts.append(f"![a scene in which only the policy fails]({picture})")
    for title, rows in tables(comparison, corpus).items():
        left = f"\n\n… and {len(rows) - SHOWN} more" if len(rows) > SHOWN else ""
        parts.append(f"### {_cell(title)}\n\n{markdown_table(rows[:SHOWN])}{left}")
    return "\n\n".join(filter(None, parts)) + "\n"


def markdown_table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Rows with the same keys as a table of GitHub's Markdown."""
    heads = list(rows[0]) if rows else []
    lines = [heads, ["---"] * len(heads), *([_cell(row[head]) for head in heads] for row in rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _cell(value: object) -> str:
    """Text without Markdown or HTML of its own: names and details come from files and servers."""
    text = " ".join(str(value).split())
    for sign in ("\\", "|", "<", "*", "_", "`", "[", "]", "!"):
        text = text.replace(sign, f"\\{sign}")
    return text
