"""Checks of what a store or corpus holds as JSON, when it is read: others may have written it."""

import re
from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any

from pydantic import BaseModel, TypeAdapter, ValidationError

from vlafuzz.common.reading import first_problem, plain
from vlafuzz.common.text import shortened
from vlafuzz.model.conditions import Conditions
from vlafuzz.model.evidence import Causes

_NAME = re.compile(r"[a-z0-9][a-z0-9_.-]{0,99}")  # of an operator; which there are depends on the world


class _Pack(BaseModel):
    name: str
    digest: str
    folder: str


class _SceneFile(BaseModel):
    flag: str
    file: str
    digest: str


class _Place(BaseModel):
    processor: str
    instructions: str
    torch: str


class _Spec(BaseModel):
    cameras: list[dict[str, Any]] = []


_KINDS: Mapping[str, TypeAdapter[Any]] = {
    "packs": TypeAdapter(list[_Pack]),
    "scene_file": TypeAdapter(_SceneFile),
    "place": TypeAdapter(_Place),
    "spec": TypeAdapter(_Spec),
    "operators": TypeAdapter(dict[str, Any]),
}


def check_read(conditions: Conditions) -> None:
    """Raise a ValueError if a text has unseen signs, or a field for JSON, unless it is empty, has none."""
    for text in (*vars(conditions).values(), *conditions.world, *conditions.world.values()):
        plain(text if isinstance(text, str) else "")
    for name, kind in _KINDS.items():
        try:
            if text := getattr(conditions, name):
                kind.validate_json(text)
        except ValidationError as error:
            raise ValueError(f"{name}: {first_problem(error)}") from None


def check_operators(causes: Causes, *several: Iterable[str]) -> None:
    """Raise a ValueError if evidence names an operator as none is named, or one twice in a list."""
    thresholds = [threshold.operator for threshold in causes.thresholds]
    for names in (causes.necessary, causes.sufficient, thresholds, *several):
        for name, times in Counter(list(names)).items():
            if not _NAME.fullmatch(name):
                raise ValueError(f"{shortened(name)} is no name of an operator")
            if times > 1:
                raise ValueError(f"operator {name!r} is named {times} times")
