"""Packs: objects in a folder of the user's, with the layout of SIMPLER, VLATest and ManiSkill.

    FOLDER/info_*.json              scales and density of every object, by name
    FOLDER/models/NAME/collision.*  the collision mesh: obj or ply
    FOLDER/models/NAME/textured.*   the visual mesh: glb, dae or obj, with textures beside it; optional

In the catalogue, names have the pack's as a prefix, ``ycb:apple``, since the built-in objects have similar names.
"""

import hashlib
import html
import json
import os
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Annotated
from urllib.parse import unquote

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter

from vlafuzz.common.assets import FOLDERS, listed
from vlafuzz.common.reading import MIB, is_within, read_bytes, read_json, validated
from vlafuzz.errors import CatalogueError, UsageError

_SOLIDS = ("collision.obj", "collision.ply")
_LOOKS = ("textured.glb", "textured.dae", "textured.obj")
_LAYOUT = "a pack has info_*.json and models/NAME/collision.obj (SIMPLER, VLATest) or .ply (ManiSkill's YCB)"
_ELSEWHERE = f"{FOLDERS}=FOLDER says where it is"
_PLAIN = re.compile(r"[\w. -]{1,100}")
_UNSPOKEN = re.compile(r"opened|baked|bridge|generated|modified|objaverse|v\d+|\d+cm")
MOST_BYTES = 64 * MIB  # of a file
_NAME_NOTHING = (".png", ".jpg", ".jpeg", ".ply", ".stl", ".json")  # formats whose files name no others
_ENDS = re.compile(r"""["'<>\0\r\n\f]+|\\(?=[\r\n])""")  # of what may be one name, in any of the formats
_NUMBERS = re.compile(r"[-+.,/\deE\s]*")
_MARKER = "dummy_"  # prefix of planes that mark a place for SIMPLER's tasks
_MARKERS = {"dummy_sink_target_plane": "yellow basket"}  # spoken names of those that are used


class PackObject(BaseModel):
    """One object of a pack. The dump identifies it by the ``content`` of its files, not by their paths."""

    model_config = ConfigDict(frozen=True)

    spoken: str
    scale: Annotated[float, Field(gt=0, le=1000, allow_inf_nan=False)]
    density: Annotated[float, Field(gt=0, le=1e6, allow_inf_nan=False)]  # kilograms per cubic metre
    sides: tuple[float, float, float] | None  # in the info file, along the mesh's axes, metres
    tall_y: bool  # whether an object that is tall and round along y stands along y; all others have z up
    marks: bool  # whether the object is a plane that stands for a place
    content: str
    collision: Path = Field(exclude=True)
    visual: Path | None = Field(exclude=True)
    version: int = 6  # of the builder; raise it when the same files result in a different object


@dataclass(frozen=True, eq=False)
class Pack:
    """The objects of a folder."""

    name: str
    folder: Path
    digest: str  # of everything that determines the objects: the files' bytes, scales and densities
    objects: dict[str, PackObject]  # by their names in the pack


class _Box(BaseModel):
    min: tuple[float, float, float]
    max: tuple[float, float, float]

    def sides(self, scale: float) -> tuple[float, float, float]:
        x, y, z = (scale * (high - low) for low, high in zip(self.min, self.max, strict=True))
        return x, y, z


class _Info(BaseModel):
    """An entry of an info file. Some bounding boxes are wrong; only the published criteria use them."""

    bbox: _Box | None = None
    scales: Annotated[list[Annotated[float, Field(gt=0, le=1, allow_inf_nan=False)]], Field(min_length=1)] = [1.0]
    density: Annotated[float, Field(gt=0, le=1e6, allow_inf_nan=False)] = 1000.0


_INFOS = TypeAdapter(dict[str, _Info])


def open_packs(source: str) -> tuple[Pack, ...]:
    """The pack in a folder, or the packs in its subfolders; else a UsageError."""
    if packs := _packs_in(Path(source)):
        return packs
    problem = "neither a pack of objects nor a folder of packs" if os.path.isdir(source) else "no such folder"
    raise UsageError(f"{source}: {problem}", hint=_LAYOUT)


def _known_packs() -> Iterator[Pack]:
    """The packs in the folders of ``$VLAFUZZ_PACKS``."""
    for folder in listed():
        yield from _packs_in(Path(folder))


def find_pack(name: str, digest: str, folder: str) -> Pack:
    """A pack that was used before, from its former folder or among those known here; else a UsageError.

    Falls back to a changed pack of that name, which changes the catalogue's digest.
    """
    here = [*_packs_in(Path(folder)), *_known_packs()]
    same = [pack for pack in here if pack.digest == digest] + [pack for pack in here if pack.name == name]
    if not same:
        problem = f"it needs the pack {name!r} (digest {digest}), which is neither in {folder} nor in ${FOLDERS}"
        raise UsageError(problem, hint=_ELSEWHERE)
    return replace(same[0], name=name)


def packs_of(objects: Iterable[str]) -> tuple[Pack, ...]:
    """The known packs that objects of these names are from; a UsageError if one is not known here."""
    named = sorted({name.partition(":")[0] for name in objects if ":" in name})
    known = {pack.name: pack for pack in _known_packs()} if named else {}
    for name in named:
        if name not in known:
            raise UsageError(f"there are objects of the pack {name!r}, which is not here", hint=_ELSEWHERE)
    return tuple(known[name] for name in named)


def spoken(name: str) -> str:
    """The spoken name of an object: its name without the words that only distinguish meshes."""
    words = name.replace("-", "_").split("_")
    return " ".join(word for word in words if not _UNSPOKEN.fullmatch(word)) or name


def _packs_in(folder: Path) -> tuple[Pack, ...]:
    if _is_pack(folder):
        return (_read(folder),)
    inside = sorted(folder.iterdir()) if os.path.isdir(folder) else []
    return tuple(_read(path) for path in inside if _is_pack(path))


def _is_pack(folder: Path) -> bool:
    return os.path.isdir(folder / "models") and any(folder.glob("info_*.json"))


def _read(folder: Path) -> Pack:
    bare = re.sub(r"^mani_skill2_|[-_]dataset$", "", folder.resolve().name.lower())
    pack_name = re.sub(r"[^a-z0-9_-]", "-", bare)
    tall_y = "custom" in pack_name or any(folder.glob("info_*custom*.json"))
    objects: dict[str, PackObject] = {}
    for name, info in _infos(folder):
        collision = _first(folder / "models" / name, _SOLIDS)
        if collision is not None and (name in _MARKERS or not name.startswith(_MARKER)):
            scale, box = info.scales[0], info.bbox
            objects[name] = PackObject(
                spoken=_MARKERS.get(name) or spoken(name),
                scale=scale,
                density=info.density,
                sides=box.sides(scale) if box else None,
                tall_y=tall_y,
                marks=name in _MARKERS,
                content=_content(collision.parent, folder),
                collision=collision,
                visual=_first(collision.parent, _LOOKS),
            )
    if not objects:
        raise UsageError(f"{folder}: a pack without objects: models/ has none of its names", hint=_LAYOUT)
    facts = {name: entry.model_dump(mode="json") for name, entry in objects.items()}
    digest = hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()[:16]
    return Pack(pack_name, folder.resolve(), digest, objects)


def _infos(folder: Path) -> Iterable[tuple[str, _Info]]:
    """The info files' entries; of several for one object, the one with the largest scale: real size."""
    entries: dict[str, _Info] = {}
    for path in sorted(folder.glob("info_*.json")):
        read = validated(_INFOS, read_json(path, CatalogueError, inside=folder), path, CatalogueError)
        for name, info in read.items():
            if name in (".", "..") or not _PLAIN.fullmatch(name):  # names are also those of folders
                wrong = f"{path}: {name!r}: expected a name of at most 100 letters, digits, '_', '-', '.'"
                raise CatalogueError(wrong)
            if name not in entries or info.scales[0] > entries[name].scales[0]:
                entries[name] = info
    return sorted(entries.items())


def _first(folder: Path, names: Iterable[str]) -> Path | None:
    return next((folder / name for name in names if (folder / name).is_file()), None)


def _content(folder: Path, pack: Path) -> str:
    digest = hashlib.sha256()
    for file in sorted(folder.iterdir()):
        if not file.is_dir():
            status = file.lstat()
            found = _hash(file, pack, status.st_size, status.st_mtime_ns, status.st_ino)
            digest.update(f"{file.name} {found}\n".encode())
    return digest.hexdigest()[:20]


@lru_cache(maxsize=4096)
def _hash(file: Path, pack: Path, *_: int) -> str:
    """Hash of a file's bytes, checked and cached until it changes, since a catalogue is loaded often."""
    check_references(file, pack)
    return hashlib.sha256(read_bytes(file, CatalogueError, most=MOST_BYTES, inside=pack)).hexdigest()


def check_references(file: Path, folder: Path) -> None:
    """Raise a CatalogueError if a file of a pack, or one that it names, is elsewhere, a link, or too large.

    Whatever its format, everything in a file that is the path of another one counts as its name. A name without a file
    is harmless: some meshes still have a path of their author's machine.
    """
    waiting, known = [file], {file}
    while waiting:
        file = waiting.pop()
        data = read_bytes(file, CatalogueError, most=MOST_BYTES, inside=folder)
        if file.suffix.lower() in _NAME_NOTHING:
            continue
        for name in set(_names(data)):
            place = Path(os.path.normpath(file.parent / name))
            if place in known or not os.path.exists(place) or os.path.isdir(place):
                continue
            if not is_within(place, folder):
                hint = "copy it into the pack, if it belongs there"
                raise CatalogueError(f"{file}: names {name!r}, which is not in the pack", hint)
            waiting.append(place)
            known.add(place)


def _names(data: bytes) -> Iterator[str]:
    """Yield what could be paths in a file: its words, and what stands in a line or between quotes after a keyword."""
    if data.startswith(b"glTF"):
        data = data[20 : 20 + int.from_bytes(data[12:16], "little")]  # the JSON part
    text = re.sub(r"\\u00([0-7][0-9a-fA-F])", lambda code: chr(int(code[1], 16)), data.decode("utf-8", "replace"))
    for part in _ENDS.split(html.unescape(text)):
        keyword, _, rest = part.strip().partition(" ")
        if not _NUMBERS.fullmatch(rest or keyword):
            for name in (part.strip(), rest, *part.split()):
                if len(name) <= 4096:
                    yield unquote(name.replace("\\", "/").removeprefix("file://").removeprefix("package://"))
