"""The pages of the documentation: their blocks of commands, with marks, and the files that they show."""

import re
import shlex
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parent.parent
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))
SLOW, NOT_RUN = "slow", "not run: "
_BLOCK = re.compile(r"(?:^<!-- ([^\n]*) -->\n)?^```console\n(.*?)^```$", re.DOTALL | re.MULTILINE)
_FILE = re.compile(r'^```\w+ title="([^"\n]+)"\n(.*?)^```$', re.DOTALL | re.MULTILINE)
_CODE = re.compile(r"`(vlafuzz [^`\n]+)`")


@dataclass(frozen=True)
class Block:
    """A console block. ``mark``: the comment above it, "" for none; ``commands``: the words after each $."""

    mark: str
    commands: tuple[tuple[str, ...], ...]


def text(name: str) -> str:
    """A page by its path in the checkout."""
    return (ROOT / name).read_text(encoding="utf-8")


def blocks(page: Path) -> list[Block]:
    """The console blocks of a page, in order."""
    parts = _BLOCK.findall(page.read_text(encoding="utf-8"))
    typed = ((mark, re.findall(r"^\$ (.*)$", block, re.MULTILINE)) for mark, block in parts)
    return [Block(mark, tuple(map(_words, lines))) for mark, lines in typed]


def files(page: Path) -> dict[str, str]:
    """The files that a page shows, by name."""
    return dict(_FILE.findall(page.read_text(encoding="utf-8")))


def calls(page: Path) -> list[tuple[str, ...]]:
    """Every call of vlafuzz that a page shows, in blocks and in the text."""
    inline = [_words(code) for code in _CODE.findall(page.read_text(encoding="utf-8"))]
    typed = [words for block in blocks(page) for words in block.commands]
    return [words for words in (*typed, *inline) if words[:1] == ("vlafuzz",)]


def _words(command: str) -> tuple[str, ...]:
    return tuple(shlex.split(command.replace("…", ""), comments=True))
