"""The files that a mesh or a robot names: materials, textures, buffers, which SAPIEN reads wherever they are.

Where its readers and Python's could understand a file differently, every name that either may find in it counts, or the
file is refused.
"""

import io
import json
import os
import re
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from urllib.parse import unquote
from xml.etree import ElementTree
from xml.parsers import expat

from vlafuzz.common.reading import MIB, is_within, read_bytes
from vlafuzz.errors import CatalogueError

MOST_BYTES = 64 * MIB  # of a file
_MOST_NAMES = 20_000  # in a file; a mesh has a texture or two, but in DAE any text may be one
_LONGEST = 4096  # bytes of a path in Linux
_NUMBERS = re.compile(r"[-+.\deE\s]*")
# SAPIEN's readers of OBJ and MTL end lines at \r, \f and \0, too, and compare only the start of a keyword
_LIBRARIES = re.compile(rb"(?:^|[\r\f\0])[ \t]*mtllib[ \t]+([^\r\n\f\0]+)", re.MULTILINE)
_TEXTURES = re.compile(
    rb"(?:^|[\r\f\0])[ \t]*(?:map_|bump|disp|decal|norm|refl)[^\s\0]*[ \t]+([^\r\n\f\0]+)", re.MULTILINE | re.IGNORECASE
)
_CONTINUED = re.compile(rb"\\[\r\n\f\0]")


def check_references(file: Path, folder: Path) -> None:
    """CatalogueError if a file in a pack's folder, or one that it names, is elsewhere, a link, or damaged.

    A name without a file is harmless: some meshes still have a path of their author's machine.
    """
    waiting, known = [file], {file}
    while waiting:
        file = waiting.pop()
        data = read_bytes(file, CatalogueError, most=MOST_BYTES, inside=folder)
        places = {file.parent / name: name for name in _named(file, data)}
        for place in places.keys() - known:
            if not os.path.exists(place) or os.path.isdir(place):
                continue
            if not is_within(place, folder):
                hint = "copy it into the pack, if it belongs there"
                raise CatalogueError(f"{file}: names {places[place]!r}, which is not in the pack", hint)
            waiting.append(place)
        known |= places.keys()


def _named(file: Path, data: bytes) -> set[str]:
    """The paths in a file, each in all ways in which a reader may understand it."""
    try:
        texts = list(_KINDS.get(file.suffix.lower(), _of_materials)(data))
    except (ValueError, LookupError, RecursionError, ElementTree.ParseError, expat.ExpatError) as error:
        raise CatalogueError(f"{file}: no mesh: {error}") from None
    names: set[str] = set()
    for text in texts:
        plain = text.strip().replace("\\", "/").removeprefix("file://")
        names |= {text, plain, unquote(plain)}
        if len(names) > _MOST_NAMES:
            raise CatalogueError(f"{file}: names more than {_MOST_NAMES} files")
    return names


def _of_obj(data: bytes) -> Iterable[str]:
    if _CONTINUED.search(data):
        raise ValueError("a line of it ends in a backslash")  # which could divide any keyword
    return _of_materials(data, _LIBRARIES)


def _of_materials(data: bytes, keywords: re.Pattern[bytes] = _TEXTURES) -> Iterable[str]:
    """As in MTL, which a library may be whatever its name: a name may have options before it, and spaces."""
    for line in keywords.findall(data):
        text = line.decode("utf-8", "replace")
        yield from (text, *text.split())


def _of_dae(data: bytes) -> Iterable[str]:
    """All texts and attributes, alone and as SAPIEN's reader calls a texture that is declared nowhere."""
    texts = [""]
    parser = expat.ParserCreate()

    def begin(_: str, attributes: dict[str, str]) -> None:
        texts.extend((*attributes.values(), ""))

    def divide(*_: object) -> None:  # that reader takes a text only up to a comment, for example
        texts.append("")

    def extend(text: str) -> None:
        if len(texts[-1]) <= _LONGEST:
            texts[-1] += text

    def refuse(*_: object) -> None:
        raise ValueError("it has a document type")  # whose entities that reader does not know

    parser.StartElementHandler, parser.CharacterDataHandler = begin, extend
    parser.EndElementHandler = parser.CommentHandler = parser.ProcessingInstructionHandler = divide
    parser.StartCdataSectionHandler = parser.EndCdataSectionHandler = divide
    parser.StartDoctypeDeclHandler = refuse
    parser.ParseFile(io.BytesIO(data))
    named = (text for text in texts if len(text) <= _LONGEST and not _NUMBERS.fullmatch(text))
    return (name for text in named for name in (text, f"{text}.jpg"))


def _of_urdf(data: bytes) -> Iterable[str]:
    named = (element.attrib.get("filename", "") for element in ElementTree.fromstring(data).iter())
    return (name.removeprefix("package://") for name in named)


def _of_glb(data: bytes) -> Iterable[str]:
    if data[:8] != b"glTF\2\0\0\0":  # SAPIEN would try its other readers
        raise ValueError("it is not glTF 2.0")
    uris: list[str] = []

    def note(pairs: list[tuple[str, object]]) -> None:  # of keys that appear twice, too
        uris.extend(value for key, value in pairs if key == "uri" and isinstance(value, str))

    json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")], object_pairs_hook=note)
    return (uri for uri in uris if not uri.startswith("data:"))


_KINDS: Mapping[str, Callable[[bytes], Iterable[str]]] = {
    ".obj": _of_obj,
    ".dae": _of_dae,
    ".glb": _of_glb,
    ".urdf": _of_urdf,
}
