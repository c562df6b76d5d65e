"""Reading what others wrote: each format in one step that is bounded in size and depth.

Whatever is wrong becomes an error of the caller's kind, with the file in it. Nothing is built before it is
known to be small enough.
"""

import io
import json
import zlib
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import yaml
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError

from vlafuzz.errors import UsageError
from vlafuzz.text import shortened

MIB = 1 << 20
MOST_YAML = MIB // 2  # bytes of a file, and of what its aliases expand to; ours have 6 kB
DEEPEST = 50  # collections inside each other
KINDS = "biuf"  # of arrays from outside: boolean, integers, floating point
T = TypeVar("T")
Array = NDArray[Any]
Problem = type[UsageError]


def read_bytes(path: Path, problem: Problem, hint: str | None = None, *, most: int = 64 * MIB) -> bytes:
    """The content of a file; an error if it cannot be read, or has more than ``most`` bytes."""
    try:
        with path.open("rb") as stream:
            data = stream.read(most + 1)
    except (OSError, ValueError) as error:  # ValueError: of a name with a zero byte
        reason = (getattr(error, "strerror", None) or str(error)).lower()
        raise problem(f"{path}: cannot be read: {reason}", hint) from None
    if len(data) > most:
        raise problem(f"{path}: cannot be read: it has more than {most / MIB:g} MiB", hint)
    return data


def read_text(path: Path, problem: Problem, hint: str | None = None, *, most: int = 64 * MIB) -> str:
    """The text of a file in UTF-8, with or without a byte order mark."""
    try:
        return read_bytes(path, problem, hint, most=most).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise problem(f"{path}: cannot be read: not UTF-8 text", hint) from None


def read_yaml(path: Path, problem: Problem, hint: str | None = None) -> Any:
    """The content of a YAML file as plain values."""
    text = read_text(path, problem, hint, most=MOST_YAML)
    try:
        _check_expanded(text)
        return yaml.load(text, _SafeLoader)
    except yaml.YAMLError as error:
        reason = str(error).replace('"<unicode string>", ', "")
        raise problem(f"{path}: not YAML: {reason}", hint) from None
    except Exception as error:  # PyYAML raises many types for values such as 2001-99-99 or !!bool x
        raise problem(f"{path}: not YAML: a malformed value: {error}", hint) from None


def read_json(path: Path, problem: Problem, hint: str | None = None) -> Any:
    """The content of a JSON file as plain values."""
    text = read_text(path, problem, hint)
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
