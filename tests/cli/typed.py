"""Commands as a user types them."""

import json
from collections.abc import Sequence

from vlafuzz.cli import main

IDLE = ("--policy", "python:tests.doubles:make_idle", "--unchecked", "--no-certify")


def typed(capsys, words: Sequence[str] | str, *, code: int = 0):
    """What a command prints that ends with this exit code: ``out`` and ``err``."""
    assert main(words.split() if isinstance(words, str) else list(words)) == code
    return capsys.readouterr()


def told(capsys, words: Sequence[str] | str, *, code: int = 0):
    """The JSON that a command prints that ends with this exit code."""
    return json.loads(typed(capsys, words, code=code).out)


def complaint(capsys, words: Sequence[str] | str, *, code: int = 2) -> str:
    """The sentence and the hint with which a command ends, and nothing else on stderr."""
    capsys.readouterr()
    said: str = typed(capsys, words, code=code).err
    assert [line.partition(": ")[0] for line in said.splitlines()] == ["error", "hint"], said
    return said
