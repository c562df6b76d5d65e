"""Object catalogues: YAML files of objects, each built when it is first asked for."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from functools import cached_property
from pathlib import Path
from types import MappingProxyType

from vlafuzz import shipped
from vlafuzz.errors import CatalogueError, suggestion
from vlafuzz.objects.cache import built, fingerprint
from vlafuzz.objects.model import Container, Grasp, ObjectModel, RestPose
from vlafuzz.objects.schema import ObjectSpec, read_file

__all__ = ["Catalogue", "Container", "Grasp", "ObjectModel", "RestPose", "load_catalogue"]


class Catalogue:
    """Objects by name.

    Attributes:
        digest: of every value in it and of the builder's version.
    """

    def __init__(self, specs: Mapping[str, ObjectSpec]) -> None:
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
        return tuple(name for name, spec in self._specs.items() if spec.role == "graspable")

    def places(self) -> tuple[str, ...]:
        """Names of the objects that others are put on or into."""
        return tuple(name for name, spec in self._specs.items() if spec.role == "place")


def load_catalogue(*paths: str | Path) -> Catalogue:
    """Read catalogue files; without any, the one that is shipped.

    Raises:
        CatalogueError: a value is wrong, or two files name the same object.
    """
    specs: dict[str, ObjectSpec] = {}
    origin: dict[str, Path] = {}
    for path in map(Path, paths or [shipped.operators_dir() / "objects" / "builtin.yaml"]):
        for name, spec in read_file(path).items():
            if name in specs:
                taken = f"{path}: objects.{name}: already in {origin[name]}"
                raise CatalogueError(taken, "rename one of them")
            specs[name], origin[name] = spec, path
    return Catalogue(specs)
