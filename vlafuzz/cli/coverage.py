"""``vlafuzz coverage``."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

from vlafuzz.cli.import_ import Frame
from vlafuzz.cli.output import print_rows, progress, stderr
from vlafuzz.errors import check_number
from vlafuzz.formats.scene_lines import is_store, read_scene_file
from vlafuzz.objects.catalogue import Catalogue, load_catalogue
from vlafuzz.space import OperatorSet, load_operators
from vlafuzz.store.store import Store
from vlafuzz.studies.coverage import SIZES, Track, covered, tracks_of_scenes, tracks_of_store


def command(
    files: Annotated[
        list[Path], typer.Argument(help="Files of scenes, JSON lines or VLATest's; stores that runs wrote.")
    ],
    first: Annotated[
        list[int] | None,
        typer.Option(help="How many of the first scenes; may be repeated.", show_default="10, 100, 1000"),
    ] = None,
    frame: Annotated[
        Frame, typer.Option(help="How VLATest's files are read: see `vlafuzz import vlatest`.")
    ] = Frame.ORIGINAL,
    operators: Annotated[
        str | None,
        typer.Option(
            help="Ranges that files of ours are measured in: YAML, or a shipped one's name.",
            show_default="tabletop",
        ),
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    csv: Annotated[bool, typer.Option("--csv", help="Print CSV.")] = False,
) -> None:
    """Measure how much of the space scenes or runs cover.

    positions: the share of 10 x 10 cells of the box from which positions are drawn that hold the first
    object of a scene; published: the value in VLATest's paper. It grows with the number of scenes, whatever
    they contain. sites: distinct sets of operators far from nominal, with the target's place. For runs also
    cells: sites with the stage at which the policy was lost; failures: the cells of its failures.
    """
    sizes = first or list(SIZES)
    for size in sizes:
        check_number("--first", size, 1, 10**9)
    catalogue, ranges = load_catalogue(), load_operators(operators)
    rows: list[dict[str, Any]] = []
    with progress() as bar:
        for path in bar.track(files, description="reading"):
            for track in _tracks(path, catalogue, ranges, frame):
                rows += [_row(path, track) | asdict(row) for row in covered(track, sizes)]
    print_rows(rows, json=json, csv=csv, title="coverage")


def _tracks(path: Path, catalogue: Catalogue, ranges: OperatorSet, frame: Frame) -> list[Track]:
    if is_store(path):
        with Store.open(path) as store:
            return tracks_of_store(store)
    source = read_scene_file(path, catalogue, frame.value)
    if source.left_out:
        stderr().print(f"{path}: {source.left_out} scenes are left out: they have unknown objects")
    return tracks_of_scenes(source.scenes(), ranges, catalogue)


def _row(path: Path, track: Track) -> dict[str, Any]:
    return {"file": str(path), "run": track.run, "strategy": track.strategy}
