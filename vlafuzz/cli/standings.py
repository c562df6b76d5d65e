"""The table of a store: how each of its policies does in each task."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from vlafuzz.cli.output import print_json, print_rows
from vlafuzz.common.files import write_whole
from vlafuzz.common.text import csv_table, markdown_table

if TYPE_CHECKING:
    from vlafuzz.cli.one_run import Done
    from vlafuzz.report.standings import Standing

TABLES = (".csv", ".md")  # endings of files


def standings(store: Path) -> tuple[Standing, ...]:
    """How each policy of a store does in each task."""
    from vlafuzz.report.standings import standings_of
    from vlafuzz.store.store import Store

    with Store.open(store) as opened:
        return standings_of(opened)


def print_several(runs: Sequence[Done], store: Path, *, json: bool) -> None:
    """Print the table of a store, or as JSON also its runs."""
    rows = standings(store)
    if json:
        documents = [done.document for done in runs]
        print_json({"tasks": documents, "standings": [one.document() for one in rows]})
    else:
        print_rows([one.row() for one in rows], title=f"policies and tasks of {store}")


def write_table(path: Path, store: Path) -> None:
    """Write the table of a store as CSV or Markdown."""
    rows = standings(store)
    if path.suffix == ".csv":
        write_whole(path, csv_table([one.document() for one in rows]))
    else:
        write_whole(path, markdown_table([one.row() for one in rows]) + "\n")
