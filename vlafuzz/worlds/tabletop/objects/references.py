"""The files that a mesh or a robot names: materials, textures, buffers.

SAPIEN would read them wherever they are.
"""

import os
import re
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from urllib.parse import unquote
from xml.etree import ElementTree

from vlafuzz.common.reading import MIB, is_within, parse_json, read_bytes
from vlafuzz.errors import CatalogueError

MOST_BYTES = 64 * MIB  # of a file
_MOST_NAMES = 1000  # in a file; a mesh has a texture or two
_LIBRARIES = re.compile(rb"^[ \t]*mtllib[ \t]+(.+)$", re.MULTILINE)
_TEXTURES = re.compile(
    rb"^[ \t]*(?:map_\w+|bump|disp|decal|norm|refl)[ \t]+(.+)$", re.MULTILINE | re.IGNORECASE
)


def check_references(file: Path, folder: Path) -> None:
    """Check that a file of a pack is a regular one, and that what it names is in the pack, too.

    A name without a file is harmless: some meshes still have a path of their author's machine.

    Args:
        folder: of the pack.

    Raises:
        CatalogueError: the file, or one that it names, is elsewhere, a link, no file, too large or damaged.
    """
    waiting, known = [file], {file}
    while waiting:
        file = waiting.pop()
        data = read_bytes(file, CatalogueError, most=MOST_BYTES, inside=folder)
        places = {file.parent / name: name for name in _named(file, data)}
        for place in filter(os.path.exists, places.keys() - known):
            if not is_within(place, folder):
                hint = "copy it into the pack, if it belongs there"
                raise CatalogueError(f"{file}: names {places[place]!r}, which is not in the pack", hint)
            if not place.is_dir():
                waiting.append(place)
        known |= places.keys()


def _named(file: Path, data: bytes) -> set[str]:
    """The paths in a file, each in all ways in which a reader may understand it."""
    try:
        texts = list(_KINDS.get(file.suffix.lower(), _of_materials)(data))
    except (ValueError, TypeError, KeyError, AttributeError, ElementTree.ParseError) as error:
        raise CatalogueError(f"{file}: no mesh: {error}") from None
    names: set[str] = set()
    for text in texts:
        plain = text.strip().replace("\\", "/").removeprefix("file://")
        names |= {plain, unquote(plain), *plain.split()}
        if len(names) > _MOST_NAMES:
            raise CatalogueError(f"{file}: names more than {_MOST_NAMES} files")
    return names


def _of_obj(data: bytes) -> Iterable[str]:
    return (match.decode("utf-8", "replace") for match in _LIBRARIES.findall(data))


def _of_materials(data: bytes) -> Iterable[str]:
    """As in MTL, which a library may be whatever its name."""
    return (match.decode("utf-8", "replace") for match in _TEXTURES.findall(data))


def _of_dae(data: bytes) -> Iterable[str]:
    named = (element for element in ElementTree.fromstring(data).iter() if isinstance(element.tag, str))
    return ("".join(element.itertext()) for element in named if element.tag.endswith(("init_from", "ref")))


def _of_urdf(data: bytes) -> Iterable[str]:
    named = (element.attrib.get("filename", "") for element in ElementTree.fromstring(data).iter())
    return (name.removeprefix("package://") for name in named)


def _of_glb(data: bytes) -> Iterable[str]:
    content = parse_json(data[20 : 20 + int.from_bytes(data[12:16], "little")])  # behind two headers
    parts = [part for kind in ("images", "buffers") for part in content.get(kind) or ()]
    return (part["uri"] for part in parts if "uri" in part and not part["uri"].startswith("data:"))


_KINDS: Mapping[str, Callable[[bytes], Iterable[str]]] = {
    ".obj": _of_obj,
    ".dae": _of_dae,
    ".glb": _of_glb,
    ".urdf": _of_urdf,
}
