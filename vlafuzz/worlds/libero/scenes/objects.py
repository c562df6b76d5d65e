"""The objects of LIBERO that may be swapped or added: their classes, and how they are said. No simulator."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache, cached_property

from pydantic import TypeAdapter

from vlafuzz.common.assets import operators_dir
from vlafuzz.common.reading import read_yaml, validated
from vlafuzz.common.text import ambiguous
from vlafuzz.errors import CatalogueError


@dataclass(frozen=True)
class Objects:
    """The content of ``libero-objects.yaml``.

    Attributes:
        classes: by class and object, how instructions say the object; the first words are ours. added: the objects that
        may be added to a task.
        fixed: what else instructions say.
    """

    classes: dict[str, dict[str, tuple[str, ...]]]
    added: tuple[str, ...]
    fixed: tuple[str, ...]

    @cached_property
    def words(self) -> dict[str, tuple[str, ...]]:
        """How each object is said."""
        return {name: words for members in self.classes.values() for name, words in members.items()}

    def alike(self, kind: str) -> tuple[str, ...]:
        """The other objects of an object's class; none for one without a class."""
        members = next((members for members in self.classes.values() if kind in members), {})
        return tuple(name for name in members if name != kind)

    def said(self, kind: str, instruction: str) -> str | None:
        """The words that stand for an object in an instruction, exactly once; None if there are none."""
        found = [words for words in self.words.get(kind, ()) if _count(words, instruction) == 1]
        return max(found, key=len, default=None)


@cache
def mistakable(kind: str, instruction: str) -> bool:
    """Whether an object could be taken for something that an instruction says, in all of its words."""
    objects = load_objects()
    known = [*objects.fixed, *(words for said in objects.words.values() for words in said)]
    here = [words for words in known if _count(words, instruction)]
    said = [words for words in here if not any(words != other and words in other for other in here)]
    return any(ambiguous(words, own) for words in said for own in objects.words[kind])


@cache
def load_objects() -> Objects:
    """Read ``operators/libero-objects.yaml``; a CatalogueError if it is malformed."""
    path, hint = operators_dir() / "libero-objects.yaml", "expected classes and fixed words"
    read = read_yaml(path, CatalogueError, hint)
    objects = validated(TypeAdapter(Objects), read, path, CatalogueError, hint)
    for name in objects.added:
        if name not in objects.words:
            raise CatalogueError(f"{path}: added: {name!r} is of no class", hint)
    for name, words in objects.words.items():
        if not words:
            raise CatalogueError(f"{path}: {name}: nothing says it", hint)
    return objects


def kind_of(name: str) -> str:
    """The object of a thing: ``milk`` of ``milk_1``."""
    return re.sub(r"_\d+$", "", name)


def replaced(words: str, others: str, text: str) -> str:
    """A text that says something else."""
    return _pattern(words).sub(others, text)


def _count(words: str, text: str) -> int:
    return len(_pattern(words).findall(text))


@cache
def _pattern(words: str) -> re.Pattern[str]:
    return re.compile(rf"\b{re.escape(words)}\b", re.IGNORECASE)
