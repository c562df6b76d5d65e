"""``vlafuzz import``."""

from __future__ import annotations

from collections import Counter
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from vlafuzz.cli.output import print_json, print_rows, progress, stderr, table
from vlafuzz.errors import UsageError
from vlafuzz.formats.scene_lines import write_scenes
from vlafuzz.formats.vlatest.read import Imported, read_vlatest
from vlafuzz.objects.catalogue import load_catalogue

app = typer.Typer(add_completion=False, no_args_is_help=True, pretty_exceptions_enable=False)


class Frame(StrEnum):
    """How VLATest's table frame is mapped to ours."""

    FIT = "fit"
    KEEP = "keep"
    ORIGINAL = "original"
    ROBOT = "robot"


@app.callback()
def _group() -> None:
    """Import scenes of other formats."""


@app.command("vlatest")
def vlatest(
    files: Annotated[list[Path], typer.Argument(help="Scene files of VLATest.")],
    out: Annotated[Path, typer.Option(help="JSON-lines file to write.")],
    frame: Annotated[
        Frame,
        typer.Option(
            help="fit: stretch their box onto ours; keep: keep distances; original: change nothing, keep "
            "their robots and names; robot: the same, seen from the robot as ours are: can be run."
        ),
    ] = Frame.FIT,
    json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Write the scenes of VLATest's files as one file of ours, in order.

    Scenes with an object that has no counterpart in our catalogue are left out, with a note; with --frame
    original or robot none are.
    """
    if out.is_dir() or not out.parent.is_dir():
        raise UsageError(f"--out: cannot write {str(out)!r}", hint="give a file in a folder that exists")
    catalogue = load_catalogue()
    with progress() as bar:
        tracked = bar.track(files, description="reading")
        imported = [read_vlatest(path, catalogue, frame=frame.value) for path in tracked]
    write_scenes(out, [scene for file in imported for scene in file.scenes])
    _print_missing(imported)
    rows = [_row(file) for file in imported]
    if json:
        print_json([row | {"missing": file.missing} for row, file in zip(rows, imported, strict=True)])
    else:
        print_rows(rows, title=str(out))


def _row(imported: Imported) -> dict[str, str | int]:
    return {
        "file": str(imported.path),
        "scenes": imported.read,
        "written": len(imported.scenes),
        "left out": imported.left_out,
    }


def _print_missing(imported: list[Imported]) -> None:
    missing: Counter[str] = Counter()
    for file in imported:
        missing.update(file.missing)
    if not missing:
        return
    left_out = sum(file.left_out for file in imported)
    rows = [{"no counterpart for": name, "scenes": count} for name, count in missing.most_common()]
    stderr().print(
        f"{left_out} scenes are left out: they have objects without a counterpart in our catalogue"
    )
    stderr().print(table(rows))
