"""Catalogue: the objects that come with vlafuzz, and those of packs, by name.

Those that come with it are in ``operators/objects``, one folder each, written by ``scripts/make_objects.py``. Those of
packs are measured on first access and cached, one folder each, named by the hash of their content.
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
from vlafuzz.model import Conditions, Placement
from vlafuzz.worlds.tabletop.objects.model import ObjectModel, Role
from vlafuzz.worlds.tabletop.objects.packs import Pack, PackObject, find_pack

BUILDER = 6  # version; raise it when the same pack results in different objects
INDEX = "builtin.json"  # marks of the objects beside it, by name
NUMBERS = "model.json"
_MODEL = TypeAdapter(ObjectModel)


class Catalogue:
    """Objects by name. ``digest``: hash of all values, the packs' files and the builder's version.

    ``shipped``: by name, the marks of the objects that come with vlafuzz.
    """

    def __init__(self, shipped: Mapping[str, str], packs: Sequence[Pack] = ()) -> None:
        self.packs = tuple(packs)
        self._packed = {f"{pack.name}:{name}": spec for pack in packs for name, spec in pack.objects.items()}
        self._marks = dict(shipped) | {name: _mark(name, spec) for name, spec in self._packed.items()}
        self._models: dict[str, ObjectModel] = {}
        self.digest = hashlib.sha256("".join(sorted(self._marks.values())).encode()).hexdigest()[:16]

    def __getitem__(self, name: str) -> ObjectModel:
        if name not in self._models:
            if name not in self._marks:
                raise CatalogueError(f"no object {name!r} in the catalogue", suggestion(name, self._marks))
            packed = self._packed.get(name)
            self._models[name] = _measured(name, packed) if packed else _load(_shipped() / name)
        return self._models[name]

    def __contains__(self, name: object) -> bool:
        return name in self._marks

    def __iter__(self) -> Iterator[str]:
        return iter(self._marks)

    def names(self, *roles: Role) -> tuple[str, ...]:
        """The names of all objects, or of those with one of some roles, in their order."""
        return tuple(name for name in self if not roles or self[name].role in roles)

    def preferred(self, names: tuple[str, ...]) -> tuple[str, ...]:
        """The default choice among some names: the packs' objects if there are any, else all."""
        packed = tuple(name for name in names if name in self._packed)
        return packed or names


def load_catalogue(*, packs: Sequence[Pack] = ()) -> Catalogue:
    """The objects that come with vlafuzz, followed by the packs'; a CatalogueError for two packs of one name."""
    folders: dict[str, Path] = {}
    for pack in packs:
        if pack.name in folders:
            both = f"{folders[pack.name]} and {pack.folder}: both packs are named {pack.name!r}"
            raise CatalogueError(both, "rename one of the folders")
        folders[pack.name] = pack.folder
    return Catalogue(json.loads((_shipped() / INDEX).read_text(encoding="utf-8")), packs)


def models_of(placements: Sequence[Placement], catalogue: Catalogue) -> tuple[ObjectModel, ...]:
    """The models of a scene's objects, scaled to their sizes."""
    return tuple(catalogue[placement.object].scaled(placement.scale) for placement in placements)


def _shipped() -> Path:
    return assets.operators_dir() / "objects"


def _mark(name: str, spec: PackObject) -> str:
    text = json.dumps([BUILDER, name, spec.model_dump(mode="json")], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:20]


def _measured(name: str, spec: PackObject) -> ObjectModel:
    """The object of a pack from the cache, measured first if necessary."""
    place = f"objects/{name.replace(':', '-')}-{_mark(name, spec)}"

    def fill(folder: Path) -> None:
        # Imported here: trimesh and scipy are not needed when the object is cached
        from vlafuzz.worlds.tabletop.objects.measured import build_measured

        write_model(build_measured(name, spec, folder), folder)

    def cached() -> ObjectModel:
        model = _load(assets.made_once(place, fill, lambda folder: (folder / NUMBERS).is_file()))
        if spec.visual is not None and spec.visual.name == model.visual.name:
            return replace(model, visual=spec.visual)
        return model

    model = cached()
    if all(file.is_file() for file in (model.visual, *model.collision)):  # SAPIEN only logs a missing mesh
        return model
    shutil.rmtree(model.collision[0].parent, ignore_errors=True)
    return cached()


def write_model(model: ObjectModel, folder: Path) -> None:
    """Write a model whose meshes are in ``folder``, which may then be moved."""
    visual, collision = Path(model.visual.name), tuple(Path(file.name) for file in model.collision)
    (folder / NUMBERS).write_bytes(_MODEL.dump_json(replace(model, visual=visual, collision=collision), by_alias=True))


def _load(folder: Path) -> ObjectModel:
    model = _MODEL.validate_json((folder / NUMBERS).read_bytes())
    collision = tuple(folder / file for file in model.collision)
    return replace(model, visual=folder / model.visual, collision=collision)


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
