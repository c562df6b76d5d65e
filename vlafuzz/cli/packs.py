"""The flag ``--pack``."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from vlafuzz import assets
from vlafuzz.cli.output import progress, stderr

if TYPE_CHECKING:
    from vlafuzz.objects import Pack

PackFlag = Annotated[
    list[str] | None,
    typer.Option(
        "--pack",
        help="Objects and robots from this folder, laid out as SIMPLER and VLATest do; may be repeated.",
    ),
]


def opened(given: Iterable[str] | None) -> tuple[Pack, ...]:
    """The packs that are given; what is missing in each is said once.

    Raises:
        UsageError: a folder is no pack and has none in it.
        CatalogueError: a mesh is damaged.
    """
    if not given:
        return ()
    from vlafuzz.objects import open_packs  # not before it is needed: `vlafuzz doctor` has to start anywhere

    assets.add_folders(Path(each) for each in given if Path(each).is_dir())
    packs = tuple(pack for each in given if not _is_robots_only(Path(each)) for pack in open_packs(each))
    for pack in packs:
        for said in _lacks(pack):
            stderr().print(f"note: {pack.name}: {said}", soft_wrap=True)
    _measure(packs)
    return packs


def _measure(packs: Sequence[Pack]) -> None:
    """Each object, with a bar: that takes up to some seconds for each, once."""
    from vlafuzz.objects import load_catalogue

    catalogue = load_catalogue(packs=packs)
    names = catalogue.preferred(catalogue.names()) if packs else ()
    with progress() as bar:
        for name in bar.track(names, description="objects measured"):
            catalogue[name]


def _is_robots_only(folder: Path) -> bool:
    """Whether there are robots in it, and nothing that could be objects."""
    beside = {each.name for each in folder.iterdir() if each.is_dir()} if folder.is_dir() else set()
    return "robots" in beside and beside <= {"robots", "overlays"}


def _lacks(pack: Pack) -> Iterable[str]:
    plain = [name for name, each in pack.objects.items() if each.visual is None]
    if plain:
        some = ", ".join(plain[:3]) + (", …" if len(plain) > 3 else "")
        yield (
            f"{len(plain)} of {len(pack.objects)} objects have no textured mesh ({some}): "
            "they look like their collision mesh, in one colour"
        )
    if pack.left_out:
        yield f"no collision mesh, so left out: {', '.join(pack.left_out)}"
