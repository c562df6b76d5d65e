"""Mutations of valid input, from seeded random numbers: of bytes, of text, and of trees as in JSON."""

import copy
from typing import Any

import numpy as np

ESCAPE = "\x1b]0;x\x07\x9b31m\u202e\u2028"
SCALARS: tuple[Any, ...] = (
    None, True, False, 0, -1, 1, 7, 0.5, -0.0, 1e-308, 1e6, 1e30, 1e308, -1e308, 2**31, 2**63, -(2**63),
    10**30, 10**400, float("nan"), float("inf"), "", " ", "0", "nan", "x" * 300, "y" * 20_000, ESCAPE,
    "é漢🙂", "a\0b", "../../x", "/dev/null", "{a}", "%s%n", "'; DROP TABLE run; --", '"', "panda",
    "pick-up", "2001-99-99", "1e5", "python:os:getcwd",
)  # fmt: skip
TOKENS = (
    b"\x00", b"\xff\xfe", b"\xef\xbb\xbf", b"\x1b[2J", b"[" * 2000, b"{" * 300, b'{"a":' * 300, b"9" *
    5000, b"1e999", b"NaN", b"\xe2\x80\xa8", b"\r", b"\n\n", b"- ", b": ", b"&a [*a]", b"*a", b"&a ",
    b"<<: ", b"!!int x", b"!!bool x", b"!!timestamp x", b"!!python/object/apply:os.getcwd []",
    b"2001-99-99", b"0x_", b"1:99:99", b"!!binary x", b"? ", b"---\n", b"%YAML 9.9\n", b'"', b"'",
    b"\\u0000", b"\\ud800", b"null", b"true", b"-", b".inf", b"\x80" * 50,
)  # fmt: skip


def hostile(rng: np.random.Generator) -> Any:
    """A value that nobody expects: a scalar, or a small, deep or long collection of some."""
    scalar = SCALARS[rng.integers(len(SCALARS))]
    match rng.integers(12):
        case 0:
            return [scalar] * int(rng.integers(4))
        case 1:
            return {str(SCALARS[rng.integers(len(SCALARS))])[:400]: scalar} if rng.random() < 0.7 else {}
        case 2:
            for _ in range(int(rng.choice([3, 60, 200]))):
                scalar = [scalar] if rng.random() < 0.5 else {"a": scalar}
            return scalar
        case 3:
            return [scalar if not isinstance(scalar, str) else scalar[:20]] * 3000
    return scalar


def tree(rng: np.random.Generator, value: Any, times: int | None = None) -> Any:
    """A copy of a value as in JSON with one to three changes somewhere in it."""
    changed = copy.deepcopy(value)
    for _ in range(times or int(rng.choice([1, 1, 1, 2, 3]))):
        changed = _changed(rng, changed)
    return changed


def _changed(rng: np.random.Generator, value: Any) -> Any:
    if not isinstance(value, dict | list) or not value or rng.random() < 0.05:
        return _scalar(rng, value)
    keys = list(value) if isinstance(value, dict) else range(len(value))
    key = keys[int(rng.integers(len(keys)))]
    if rng.random() < 0.75:
        value[key] = _changed(rng, value[key])
        return value
    match rng.integers(4):
        case 0:
            del value[key]
        case 1 if isinstance(value, dict):
            value[str(hostile(rng))[:400]] = value.pop(key)
        case 2 if isinstance(value, dict):
            value[str(hostile(rng))[:400]] = hostile(rng)
        case 2:
            value.insert(key, copy.deepcopy(value[key]))
        case _:
            value[key] = hostile(rng)
    return value


def _scalar(rng: np.random.Generator, value: Any) -> Any:
    if isinstance(value, float | int) and abs(value) < 1e300 and value not in (True, False) and rng.random() < 0.4:
        return value * float(rng.choice([0, -1, 1e-9, 1.0001234567891, 1e3, 1e9, 1e300]))
    if isinstance(value, str) and rng.random() < 0.3:
        return text(rng, value)
    return hostile(rng)


def text(rng: np.random.Generator, value: str) -> str:
    """A changed text."""
    return data(rng, value.encode("utf-8", "replace")).decode("utf-8", "replace")


def data(rng: np.random.Generator, value: bytes, times: int | None = None) -> bytes:
    """Changed bytes: some flipped, cut out, doubled or inserted."""
    changed = bytearray(value)
    for _ in range(times or int(rng.choice([1, 1, 2, 4]))):
        first, last = sorted(rng.integers(0, len(changed) + 1, 2).tolist())
        last = min(last, first + int(rng.choice([1, 4, 64, 10_000])))
        match rng.integers(6):
            case 0:
                changed[first:last] = rng.integers(0, 256, last - first, dtype=np.uint8).tobytes()
            case 1:
                del changed[first:last]
            case 2:
                changed[first:first] = changed[first:last]
            case 3:
                del changed[first:]
            case _:
                changed[first:first] = TOKENS[rng.integers(len(TOKENS))]
    return bytes(changed)
