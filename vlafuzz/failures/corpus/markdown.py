"""A comparison as Markdown, for the summary of a job or a comment."""

from pathlib import Path

from vlafuzz.common.files import write_whole, writing
from vlafuzz.common.text import markdown_table, markdown_text
from vlafuzz.failures.corpus.corpus import Corpus
from vlafuzz.failures.corpus.regress import Comparison
from vlafuzz.failures.corpus.tables import difference, tables

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
    parts = [
        f"## {sign} {markdown_text(comparison.verdict)}",
        markdown_text(comparison.changes),
        difference(comparison),
    ]
    if picture is not None:
        parts.append(f"![a scene in which only the policy fails]({picture})")
    for title, rows in tables(comparison, corpus).items():
        left = f"\n\n… and {len(rows) - SHOWN} more" if len(rows) > SHOWN else ""
        parts.append(f"### {markdown_text(title)}\n\n{markdown_table(rows[:SHOWN])}{left}")
    return "\n\n".join(filter(None, parts)) + "\n"
