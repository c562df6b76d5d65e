"""Catalogue: the objects of YAML files and packs by name, each built on first access.

Built objects are cached, one folder each, named by the hash of the entry and the builder's version.
"""

import hashlib
import json
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from pydantic import TypeAdapter

from vlafuzz.common import assets
from vlafuzz.errors import CatalogueError, suggestion
from vlafuzz.model.conditions import Conditions
from vlafuzz.worlds.tabletop.objects.model import ObjectModel, Role
from vlafuzz.worlds.tabletop.objects.packs import Pack, PackObject, find_pack
from vlafuzz.worlds.tabletop.objects.schema import ObjectSpec, read_file

Entry = ObjectSpec | PackObject
BUILDER = 6  # version; raise it when the same entry builds a different object, which a test detects
NUMBERS = "model.json"
_MODEL = TypeAdapter(ObjectModel)


class Catalogue:
    """Objects by name. ``digest``: hash of all values, the packs' files and the builder's version."""

    def __init__(self, specs: Mapping[str, Entry], packs: Sequence[Pack] = ()) -> None:
        self._specs, self.packs = dict(specs), tuple(packs)
        self._built: dict[str, ObjectModel] = {}
        marks = sorted(_fingerprint(name, spec) for name, spec in self._specs.items())
        self.digest = hashlib.sha256("".join(marks).encode()).hexdigest()[:16]

    def __getitem__(self, name: str) -> ObjectModel:
        if name not in self._built:
            if name not in self._specs:
                raise CatalogueError(f"no object {name!r} in the catalogue", suggestion(name, self._specs))
            self._built[name] = _built(name, self._specs[name])
        return self._built[name]

    def __contains__(self, name: object) -> bool:
        return name in self._specs

    def __iter__(self) -> Iterator[str]:
        return iter(self._specs)

    def __len__(self) -> int:
        return len(self._specs)

    def names(self, *roles: Role) -> tuple[str, ...]:
        """The names of all objects, or of those with one of some roles, in the order of the files."""

        def role(name: str, spec: Entry) -> Role:
            return self[name].role if isinstance(spec, PackObject) else spec.role  # packs' are measured

        return tuple(name for name, spec in self._specs.items() if not roles or role(name, spec) in roles)

    def graspable(self) -> tuple[str, ...]:
        """Names of the objects that a gripper can pick up."""
        return self.names("graspable")

    def preferred(self, names: tuple[str, ...]) -> tuple[str, ...]:
        """The default choice among some names: the packs' objects if there are any, else all."""
        packed = tuple(name for name in names if isinstance(self._specs[name], PackObject))
        return packed or names


def load_catalogue(file: Path | None = None, *, packs: Sequence[Pack] = ()) -> Catalogue:
    """The objects of a catalogue file, by default of the shipped one, followed by the packs' objects.

    A CatalogueError says which value is invalid, or which two packs have the same name.
    """
    specs: dict[str, Entry] = {**read_file(file or assets.operators_dir() / "objects" / "builtin.yaml")}
    folders: dict[str, Path] = {}
    for pack in packs:
        if pack.name in folders:
            both = f"{folders[pack.name]} and {pack.folder}: both packs are named {pack.name!r}"
            raise CatalogueError(both, "rename one of the folders")
        folders[pack.name] = pack.folder
        specs |= {f"{pack.name}:{name}": spec for name, spec in pack.objects.items()}
    return Catalogue(specs, packs)


def _fingerprint(name: str, spec: Entry) -> str:
    text = json.dumps([BUILDER, name, spec.model_dump(mode="json")], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:20]


def _built(name: str, spec: Entry) -> ObjectModel:
    """The object from the cache, built first if necessary."""
    place = f"objects/{name.replace(':', '-')}-{_fingerprint(name, spec)}"

    def cached() -> ObjectModel:
        folder = assets.made_once(
            place, lambda folder: _fill(name, spec, folder), lambda folder: (folder / NUMBERS).is_file()
        )
        return _load(folder, spec)

    model = cached()
    if all(file.is_file() for file in (model.visual, *model.collision)):  # SAPIEN only logs a missing mesh
        return model
    shutil.rmtree(model.collision[0].parent, ignore_errors=True)
    return cached()


def _fill(name: str, spec: Entry, folder: Path) -> None:
    # Imported here: trimesh and scipy are not needed when the object is cached
    if isinstance(spec, PackObject):
        from vlafuzz.worlds.tabletop.objects.measured import build_measured

        model = build_measured(name, spec, folder)
    else:
        from vlafuzz.worlds.tabletop.objects.build import build

        model = build(name, spec, folder)
    visual, collision = Path(model.visual.name), tuple(Path(file.name) for file in model.collision)
    (folder / NUMBERS).write_bytes(_MODEL.dump_json(replace(model, visual=visual, collision=collision), by_alias=True))


def _load(folder: Path, spec: Entry) -> ObjectModel:
    model = _MODEL.validate_json((folder / NUMBERS).read_bytes())
    visual = folder / model.visual
    if isinstance(spec, PackObject) and spec.visual and spec.visual.name == model.visual.name:
        visual = spec.visual  # the pack's own mesh, unless it was painted
    return replace(model, visual=visual, collision=tuple(folder / file for file in model.collision))


def packs_json(packs: Iterable[Pack]) -> str:
    """Packs as a field of conditions: the digest says what they are, the folder where to look first."""
    return json.dumps([{"name": pack.name, "digest": pack.digest, "folder": str(pack.folder)} for pack in packs])


def stored_catalogue(*several: Conditions) -> Catalogue:
    """The catalogue with the packs of all these conditions; a UsageError if one is gone.

    Robots that lie beside packs are found again, too.
    """
    marks = {mark["name"]: mark for conditions in several for mark in json.loads(conditions.packs)}
    packs = tuple(find_pack(**mark) for mark in marks.values())
    folders = dict.fromkeys(folder for pack in packs for folder in (pack.folder, pack.folder.parent))
    assets.add_folders(folder for folder in folders if (folder / "robots").is_dir())
    return load_catalogue(packs=packs)
