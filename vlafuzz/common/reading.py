"""Reading what others wrote: each format in one step that is bounded in size and depth.

Whatever is wrong becomes an error of the caller's kind, with the file in it. Nothing is built before it is known to be
small enough.
"""

import io
import json
import os
import re
import stat
import zlib
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, TypeVar

import numpy as np
import yaml
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError

from vlafuzz.common.text import shortened
from vlafuzz.errors import UsageError

if TYPE_CHECKING:
    from PIL.Image import Image

_OURS = Path(__file__).parents[1]  # the package, whose files some installers link
MIB = 1 << 20
MOST_YAML = MIB // 2  # bytes of a file, and of what its aliases expand to; ours have 6 kB
DEEPEST = 50  # collections inside each other
MOST_PIXELS = 8192**2  # of a picture
KINDS = "biuf"  # of arrays from outside: boolean, integers, floating point
_STEERING = re.compile("[\\x00-\\x08\\x0b-\\x1f\\x7f-\\x9f\\u061c\\u200e\\u200f\\u2028-\\u202e\\u2066-\\u2069]")
T = TypeVar("T")
Array = NDArray[Any]
Problem = type[UsageError]


def read_bytes(
    path: Path, problem: Problem, hint: str | None = None, *, most: int = 64 * MIB, inside: Path | None = None
) -> bytes:
    """The content of a file; a ``problem`` if it cannot be read, or has more than ``most`` bytes.

    Args:
        inside: the folder that somebody else filled, in which it must be a regular file behind no link; None for a file
            that the user names, which may be a pipe.
    """
    try:
        with path.open("rb") if inside is None else _opened(path, inside) as stream:
            small = os.fstat(stream.fileno()).st_size <= most
            data = stream.read(most + 1) if small else b""
    except (OSError, ValueError) as error:  # ValueError: of a name with a zero byte
        reason = (getattr(error, "strerror", None) or str(error)).lower()
        raise problem(f"{path}: cannot be read: {reason}", hint) from None
    if not small or len(data) > most:
        raise problem(f"{path}: cannot be read: it has more than {most / MIB:g} MiB", hint)
    return data


def is_within(path: Path, folder: Path) -> bool:
    """Whether a path is beneath a folder, and no link leads to it from there."""
    relative = os.path.relpath(path, folder)
    beneath = relative.partition(os.sep)[0] != os.pardir
    return beneath and os.path.realpath(path) == os.path.join(os.path.realpath(folder), relative)


def _opened(path: Path, folder: Path) -> BinaryIO:
    """A regular file in a folder, opened without waiting for a pipe; OSError for anything else."""
    if folder.is_relative_to(_OURS):
        return path.open("rb")
    if not is_within(path, folder):
        raise OSError("a link, or a path that leads out of the folder")
    opened = open(os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK), "rb")  # noqa: SIM115
    if not stat.S_ISREG(os.fstat(opened.fileno()).st_mode):
        opened.close()
        raise OSError("not a regular file")
    return opened


def decoded(data: bytes, *kinds: str) -> "Image":
    """A picture of one of these kinds, such as PNG, in memory; ValueError when it is none, or too large."""
    from PIL import Image

    try:
        picture = Image.open(io.BytesIO(data), formats=kinds)
        if picture.width * picture.height > MOST_PIXELS:
            raise ValueError(f"it has {picture.width} x {picture.height} pixels")
        picture.load()
    except Exception as error:  # Pillow's readers raise all kinds of errors for damaged files
        raise ValueError(f"no picture: {error}") from None
    return picture


def read_text(
    path: Path, problem: Problem, hint: str | None = None, *, most: int = 64 * MIB, inside: Path | None = None
) -> str:
    """The text of a file in UTF-8, with or without a byte order mark; ``inside`` as in ``read_bytes``."""
    try:
        return read_bytes(path, problem, hint, most=most, inside=inside).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise problem(f"{path}: cannot be read: not UTF-8 text", hint) from None


def read_yaml(path: Path, problem: Problem, hint: str | None = None) -> Any:
    """The content of a YAML file as plain values."""
    text = read_text(path, problem, hint, most=MOST_YAML)
    try:
        _check_expanded(text)
        if (content := yaml.load(text, _SafeLoader)) is not None:  # noqa: S506 - it is safe, and in C where there is one
            return content
    except yaml.YAMLError as error:
        reason = str(error).replace('"<unicode string>", ', "")
        raise problem(f"{path}: not YAML: {reason}", hint) from None
    except Exception as error:  # PyYAML raises many types for values such as 2001-99-99 or !!bool x
        raise problem(f"{path}: not YAML: a malformed value: {error}", hint) from None
    raise problem(f"{path}: is empty", hint)


def read_json(path: Path, problem: Problem, hint: str | None = None, *, inside: Path | None = None) -> Any:
    """The content of a JSON file as plain values; ``inside`` as in ``read_bytes``."""
    text = read_text(path, problem, hint, inside=inside)
    try:
        return parse_json(text)
    except ValueError as error:
        raise problem(f"{path}: not JSON: {error}", hint) from None


def parse_json(text: str | bytes) -> Any:
    """The value that a JSON text describes; ValueError if it is none, or nested too deeply."""
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError("nested too deeply") from None


def validated(
    kind: type[T] | TypeAdapter[T], value: object, where: object, problem: Problem, hint: str | None = None
) -> T:
    """A value as a type that pydantic knows; an error with ``where``, the key and what is there."""
    adapter = kind if isinstance(kind, TypeAdapter) else TypeAdapter(kind)
    try:
        return adapter.validate_python(value)
    except ValidationError as error:
        raise problem(f"{where}: {first_problem(error)}", hint) from None


def first_problem(error: ValidationError) -> str:
    """Pydantic's first error in words: the place, what is wrong, and the value."""
    first = error.errors(include_url=False)[0]
    place = ".".join(str(step) for step in first["loc"])
    message = first["msg"].removeprefix("Value error, ").partition(" or instance of")[0]
    got = "" if first["type"] in ("missing", "value_error") else f", got {shortened(first['input'])}"
    return f"{place + ': ' if place else ''}{message[:1].lower()}{message[1:]}{got}"


def plain(text: str) -> str:
    """The same text; ValueError if it has control characters, or signs that turn the direction of writing."""
    if _STEERING.search(text):
        raise ValueError(f"it has signs that cannot be seen: {shortened(text)}")
    return text


def inflated(data: bytes, most: int) -> bytes:
    """What zlib compressed; ValueError if it is damaged, or more than ``most`` bytes."""
    unpacker = zlib.decompressobj()
    try:
        content = unpacker.decompress(data, most)
    except zlib.error as error:
        raise ValueError(str(error)) from None
    if unpacker.unconsumed_tail:
        raise ValueError(f"it has more than {most} bytes")
    if not unpacker.eof:
        raise ValueError("its end is missing")
    return content


def array_of(data: bytes, dtype: object, shape: Any) -> Array:
    """An array of numbers from its bytes; ValueError or TypeError when they are not one."""
    kind = np.dtype(dtype)  # type: ignore[call-overload]  # anything may have been sent: TypeError
    if kind.kind not in KINDS:
        raise ValueError(f"an array of {kind}")
    return np.frombuffer(data, kind).reshape(shape).copy()  # a writable one


def npy_array(data: bytes) -> Array:
    """An array from .npy bytes, no larger than they are; ValueError when they are not one."""
    file = io.BytesIO(data)
    read = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
    try:
        shape, by_columns, kind = read[np.lib.format.read_magic(file)](file)
        array = array_of(file.read(), kind, shape[::-1] if by_columns else shape)
    except Exception as error:  # NumPy raises many types on malformed data
        raise ValueError(f"no array: {error}") from None
    return array.T if by_columns else array


_SafeLoader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


def _check_expanded(text: str) -> None:
    """YAMLError for a text that is nested too deeply, or too long with its aliases written out."""
    sizes: dict[str, int] = {}  # of anchored nodes
    inside: list[tuple[str | None, int]] = [(None, 0)]  # the open collections: anchor, and size so far
    for event in yaml.parse(text, _SafeLoader):
        if isinstance(event, yaml.CollectionStartEvent):
            inside.append((event.anchor, 1))
            if len(inside) > DEEPEST:
                raise yaml.YAMLError("nested too deeply")
            continue
        if isinstance(event, yaml.CollectionEndEvent):
            anchor, size = inside.pop()
        elif isinstance(event, yaml.ScalarEvent):
            anchor, size = event.anchor, 1 + len(event.value)
        elif isinstance(event, yaml.AliasEvent):
            endless = event.anchor in [anchor for anchor, _ in inside]
            anchor, size = None, MOST_YAML if endless else sizes.get(event.anchor or "", 0)
        else:
            continue
        if anchor is not None:
            sizes[anchor] = size
        inside[-1] = (inside[-1][0], inside[-1][1] + size)
        if inside[-1][1] > MOST_YAML:
            raise yaml.YAMLError("its aliases (*) repeat too much")
