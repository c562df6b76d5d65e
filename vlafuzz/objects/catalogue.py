"""Catalogue: the objects of YAML files and packs by name, each built on first access."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from types import MappingProxyType

from vlafuzz import shipped
from vlafuzz.errors import CatalogueError, suggestion
from vlafuzz.objects.cache import Entry, built, fingerprint
from vlafuzz.objects.model import ObjectModel, Role
from vlafuzz.objects.packs import Pack, PackObject
from vlafuzz.objects.schema import read_file


class Catalogue:
    """Objects by name.

    Attributes:
        digest: hash of all values, the packs' files and the builder's version.
    """

    def __init__(self, specs: Mapping[str, Entry]) -> None:
        self._specs = dict(specs)
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
        return (
            self[name].role if isinstance(spec, PackObject) else spec.role
        )  # the role of a pack's object is measured


def load_catalogue(*paths: str | Path, packs: Sequence[Pack] = ()) -> Catalogue:
    """Read catalogue files, by default the shipped one, followed by the packs' objects.

    Raises:
        CatalogueError: a value is invalid, or two files define the same object.
    """
    specs: dict[str, Entry] = {}
    origin: dict[str, Path] = {}
    for path in map(Path, paths or [shipped.operators_dir() / "objects" / "builtin.yaml"]):
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
    return Catalogue(specs)
