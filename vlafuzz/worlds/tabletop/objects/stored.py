"""Packs of objects as conditions keep them, and how they are found again."""

import json
from collections.abc import Iterable

from vlafuzz.common import assets
from vlafuzz.model.conditions import Conditions
from vlafuzz.worlds.tabletop.objects.catalogue import Catalogue, load_catalogue
from vlafuzz.worlds.tabletop.objects.packs import Pack, find_pack


def packs_json(packs: Iterable[Pack]) -> str:
    """Packs as a field of conditions: the digest says what they are, the folder where to look first."""
    return json.dumps(
        [{"name": pack.name, "digest": pack.digest, "folder": str(pack.folder)} for pack in packs]
    )


def stored_packs(*several: Conditions) -> tuple[Pack, ...]:
    """The packs that ``packs_json`` wrote, each once; robots that lie beside them are found again, too."""
    marks = {mark["name"]: mark for conditions in several for mark in json.loads(conditions.packs)}
    packs = tuple(find_pack(**mark) for mark in marks.values())
    folders = dict.fromkeys(folder for pack in packs for folder in (pack.folder, pack.folder.parent))
    assets.add_folders(folder for folder in folders if (folder / "robots").is_dir())
    return packs


def stored_catalogue(*several: Conditions) -> Catalogue:
    """The catalogue with the packs of all these conditions; a UsageError if one is gone."""
    return load_catalogue(packs=stored_packs(*several))
