"""Catalogue: the objects of YAML files and packs by name, each built on first access.

Built objects are cached, one folder each, named by the hash of the entry and the builder's version.
"""

import hashlib
import json
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cached_property, partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from vlafuzz.common import assets
from vlafuzz.errors import CatalogueError, suggestion
from vlafuzz.model.conditions import Conditions
from vlafuzz.worlds.tabletop.objects.model import Container, Fit, Grasp, ObjectModel, Role, StablePose
from vlafuzz.worlds.tabletop.objects.packs import Pack, PackObject, find_pack
from vlafuzz.worlds.tabletop.objects.schema import ObjectSpec, read_file

Entry = ObjectSpec | PackObject
BUILDER = 6  # version; raise it when the same entry builds a different object, which a test detects
NUMBERS = "model.json"


class Catalogue:
    """Objects by name.

    Attributes:
        digest: hash of all values, the packs' files and the builder's version.
        packs: whose objects it has beside the shipped ones.
    """

    def __init__(self, specs: Mapping[str, Entry], packs: Sequence[Pack] = ()) -> None:
        self._specs, self.packs = dict(specs), tuple(packs)
        self._built: dict[str, ObjectModel] = {}
        marks = sorted(fingerprint(name, spec) for name, spec in self._specs.items())
        self.digest = hashlib.sha256("".join(marks).encode()).hexdigest()[:16]

    def __getitem__(self, name: str) -> ObjectModel:
        if name not in self._built:
            if name not in self._specs:
                raise CatalogueError(f"no object {name!r} in the catalogue", suggestion(name, self._specs))
            self._built[name] = built(name, self._specs[name])
        return self._built[name]

    def __contains__(self, name: object) -> bool:
        return name in self._specs

    def __iter__(self) -> Iterator[str]:
        return iter(self._specs)

    def __len__(self) -> int:
        return len(self._specs)

    @cached_property
    def models(self) -> Mapping[str, ObjectModel]:
        """All objects, in the order of the files."""
        return MappingProxyType({name: self[name] for name in self._specs})

    def names(self) -> tuple[str, ...]:
        return tuple(self._specs)

    def graspable(self) -> tuple[str, ...]:
        """Names of the objects that a gripper can pick up."""
        return self._of("graspable")

    def places(self) -> tuple[str, ...]:
        """Names of the objects that others can be put on or into."""
        return self._of("place")

    def movable(self) -> tuple[str, ...]:
        """Names of the objects that can be confounders: all but places and markers."""
        return self._of("graspable", "obstacle")

    def preferred(self, names: tuple[str, ...]) -> tuple[str, ...]:
        """The default choice among some names: the packs' objects if there are any, else all."""
        packed = tuple(name for name in names if isinstance(self._specs[name], PackObject))
        return packed or names

    def _of(self, *roles: Role) -> tuple[str, ...]:
        return tuple(name for name, spec in self._specs.items() if self._role(name, spec) in roles)

    def _role(self, name: str, spec: Entry) -> Role:
        return self[name].role if isinstance(spec, PackObject) else spec.role  # packs' are measured


def load_catalogue(*paths: str | Path, packs: Sequence[Pack] = ()) -> Catalogue:
    """Read catalogue files, by default the shipped one, followed by the packs' objects.

    Raises:
        CatalogueError: a value is invalid, or two files define the same object.
    """
    specs: dict[str, Entry] = {}
    origin: dict[str, Path] = {}
    for path in map(Path, paths or [assets.operators_dir() / "objects" / "builtin.yaml"]):
        for name, spec in read_file(path).items():
            if name in specs:
                taken = f"{path}: objects.{name}: already in {origin[name]}"
                raise CatalogueError(taken, "rename one of them")
            specs[name], origin[name] = spec, path
    for number, pack in enumerate(packs):
        for other in packs[:number]:
            if other.name == pack.name:
                both = f"{other.folder} and {pack.folder}: both packs are named {pack.name!r}"
                raise CatalogueError(both, "rename one of the folders")
        specs |= {f"{pack.name}:{name}": spec for name, spec in pack.objects.items()}
    return Catalogue(specs, packs)


def fingerprint(name: str, spec: Entry) -> str:
    """Hash of an entry's values and the builder's version."""
    text = json.dumps([BUILDER, name, spec.model_dump(mode="json")], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:20]


def built(name: str, spec: Entry) -> ObjectModel:
    """The object from the cache, built first if necessary."""
    place = f"objects/{name.replace(':', '-')}-{fingerprint(name, spec)}"
    fill, is_complete = partial(_fill, name, spec), lambda folder: (folder / NUMBERS).is_file()
    model = _load(assets.made_once(place, fill, is_complete), spec)
    # SAPIEN only logs a missing mesh
    if all(file.is_file() for file in (model.visual, *model.collision)):
        return model
    shutil.rmtree(model.collision[0].parent, ignore_errors=True)
    return _load(assets.made_once(place, fill, is_complete), spec)


def _fill(name: str, spec: Entry, folder: Path) -> None:
    # Imported here: trimesh and scipy are not needed when the object is cached
    if isinstance(spec, PackObject):
        from vlafuzz.worlds.tabletop.objects.measured import build_measured

        model = build_measured(name, spec, folder)
    else:
        from vlafuzz.worlds.tabletop.objects.build import build

        model = build(name, spec, folder)
    data = _plain(vars(model))
    data["rests"] = data.pop("stable_poses")  # the files' key since the first version
    (folder / NUMBERS).write_text(json.dumps(data))


def _plain(value: Any) -> Any:
    match value:
        case np.ndarray():
            return value.tolist()
        case Path():
            return value.name
        case StablePose() | Grasp() | Container() | Fit():
            return _plain(vars(value))
        case dict():
            return {key: _plain(item) for key, item in value.items()}
        case tuple():
            return [_plain(item) for item in value]
    return value


def _load(folder: Path, spec: Entry) -> ObjectModel:
    data = json.loads((folder / NUMBERS).read_text())
    data["colour"] = _array(data["colour"])
    data["vertices"] = _array(data["vertices"])
    data["parts"] = tuple(map(_array, data["parts"]))
    packs = spec.visual if isinstance(spec, PackObject) else None
    stays = packs and packs.name == data["visual"]  # the pack's own mesh, unless it was painted
    data["visual"] = packs if stays else folder / data["visual"]
    data["collision"] = tuple(folder / name for name in data["collision"])
    data["stable_poses"] = tuple(map(_stable_pose, data.pop("rests")))
    data["container"] = data["container"] and Container(**data["container"])
    if fit := data.get("fit"):
        data["fit"] = Fit(fit["scale"], _array(fit["quaternion"]), _array(fit["position"]))
    data["box"] = data.get("box") and _array(data["box"])
    return ObjectModel(**data)


def _stable_pose(data: dict[str, Any]) -> StablePose:
    data["quaternion"] = _array(data["quaternion"])
    data["footprint"] = _array(data["footprint"])
    data["grasps"] = tuple(Grasp(**grasp) for grasp in data["grasps"])
    return StablePose(**data)


def _array(values: list[Any]) -> Any:
    array = np.array(values, dtype=np.float64)
    array.flags.writeable = False  # models are shared
    return array


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
