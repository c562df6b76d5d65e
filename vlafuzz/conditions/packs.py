"""Packs of objects as conditions keep them: the digest says what they are, the folder where to look first."""

from __future__ import annotations

import json
from collections.abc import Iterable

from vlafuzz import assets
from vlafuzz.conditions.conditions import Conditions
from vlafuzz.objects import Catalogue, Pack, find_pack, load_catalogue


def packs_json(packs: Iterable[Pack]) -> str:
    """Packs as a field of conditions."""
    return json.dumps(
        [{"name": pack.name, "digest": pack.digest, "folder": str(pack.folder)} for pack in packs]
    )


def stored_packs(*several: Conditions) -> tuple[Pack, ...]:
    """The packs that ``packs_json`` wrote, each once; robots that lie beside them are found again, too.

    Raises:
        UsageError: one of them is gone.
    """
    marks = {mark["name"]: mark for conditions in several for mark in json.loads(conditions.packs)}
    packs = tuple(find_pack(**mark) for mark in marks.values())
    folders = dict.fromkeys(folder for pack in packs for folder in (pack.folder, pack.folder.parent))
    assets.add_folders(folder for folder in folders if (folder / "robots").is_dir())
    return packs


def stored_catalogue(*several: Conditions) -> Catalogue:
    """The catalogue with the packs of all these conditions.

    Raises:
        UsageError: a pack is gone.
    """
    return load_catalogue(packs=stored_packs(*several))
