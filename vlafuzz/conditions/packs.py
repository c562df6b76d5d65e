"""A run's packs, as its manifest keeps them. The digest is what they are, the folder where to look first."""

from __future__ import annotations

import json
from collections.abc import Iterable

from vlafuzz import assets
from vlafuzz.objects import Catalogue, Pack, find_pack, load_catalogue
from vlafuzz.store.records import Manifest


def packs_json(packs: Iterable[Pack]) -> str:
    """What a manifest keeps of them."""
    return json.dumps(
        [{"name": pack.name, "digest": pack.digest, "folder": str(pack.folder)} for pack in packs]
    )


def stored_packs(*manifests: Manifest) -> tuple[Pack, ...]:
    """Those of manifests: what ``packs_json`` wrote, found again; robots that lie beside them are, too.

    Raises:
        UsageError: one of them is gone.
    """
    marks = {mark["name"]: mark for manifest in manifests for mark in json.loads(manifest.packs)}
    found = tuple(find_pack(**mark) for mark in marks.values())
    folders = dict.fromkeys(folder for pack in found for folder in (pack.folder, pack.folder.parent))
    assets.add_folders(folder for folder in folders if (folder / "robots").is_dir())
    return found


def stored_catalogue(*manifests: Manifest) -> Catalogue:
    """The catalogue with the packs of manifests.

    Raises:
        UsageError: a pack is gone.
    """
    return load_catalogue(packs=stored_packs(*manifests))


def has_packs(manifest: Manifest, packs: Iterable[Pack]) -> bool:
    """Whether a manifest's are these, wherever they are."""
    return _marks(manifest) == {(pack.name, pack.digest) for pack in packs}


def same_packs(manifest: Manifest, other: Manifest) -> bool:
    """Whether two manifests have the same packs, wherever they are."""
    return _marks(manifest) == _marks(other)


def _marks(manifest: Manifest) -> set[tuple[str, str]]:
    return {(mark["name"], mark["digest"]) for mark in json.loads(manifest.packs)}
