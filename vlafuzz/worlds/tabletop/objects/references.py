"""The files that a mesh or a robot names: materials, textures, buffers, which SAPIEN reads wherever they are."""

import html
import os
import re
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import unquote

from vlafuzz.common.reading import MIB, is_within, read_bytes
from vlafuzz.errors import CatalogueError

MOST_BYTES = 64 * MIB  # of a file
_NAME_NOTHING = (".png", ".jpg", ".jpeg", ".ply", ".stl", ".json")
_ENDS = re.compile(r"""["'<>\0\r\n\f]+|\\(?=[\r\n])""")  # of what may be one name, in any of the formats
_NUMBERS = re.compile(r"[-+.,/\deE\s]*")


def check_references(file: Path, folder: Path) -> None:
    """CatalogueError if a file in a pack's folder, or one that it names, is elsewhere, a link, or too large.

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
    """What could be paths in a file: its words, and what stands in a line or between quotes after a keyword."""
    if data.startswith(b"glTF"):
        data = data[20 : 20 + int.from_bytes(data[12:16], "little")]  # the JSON part
    text = re.sub(r"\\u00([0-7][0-9a-fA-F])", lambda code: chr(int(code[1], 16)), data.decode("utf-8", "replace"))
    for part in _ENDS.split(html.unescape(text)):
        keyword, _, rest = part.strip().partition(" ")
        if not _NUMBERS.fullmatch(rest or keyword):
            for name in (part.strip(), rest, *part.split()):
                if len(name) <= 4096:
                    yield unquote(name.replace("\\", "/").removeprefix("file://").removeprefix("package://"))
