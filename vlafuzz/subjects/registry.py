"""Subjects by name."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import cast

from vlafuzz.errors import UsageError, suggestion
from vlafuzz.plugins import is_reference, load_factory
from vlafuzz.subjects.base import Subject, SubjectSpec
from vlafuzz.subjects.controls import Frozen, Random
from vlafuzz.subjects.expert import Expert
from vlafuzz.subjects.pinhole import Pinhole

SUBJECTS: dict[str, Callable[[], Subject]] = {
    "pinhole": Pinhole,
    "expert": Expert,
    "random": Random,
    "frozen": Frozen,
}


def known_subjects() -> dict[str, str]:
    """What there is: name → what it is, in a sentence."""
    return {
        name: (inspect.getdoc(factory) or "").split("\n\n")[0].replace("\n", " ")
        for name, factory in SUBJECTS.items()
    }


def check_subject_name(name: str) -> None:
    """Fail early for a name that ``make_subject`` would not know.

    Raises:
        UsageError: no such subject.
    """
    if is_reference(name):
        load_factory(name)
    elif name not in SUBJECTS:
        hint = f"{suggestion(name, SUBJECTS)} your own: python:pkg.mod:factory"
        raise UsageError(f"unknown subject {name!r}", hint=hint)


def make_subject(name: str) -> Subject:
    """The subject of that name.

    Raises:
        UsageError: no such subject, or a factory that makes something else.
    """
    check_subject_name(name)
    if not is_reference(name):
        return SUBJECTS[name]()
    made = load_factory(name)()
    if not isinstance(getattr(made, "spec", None), SubjectSpec):
        raise UsageError(
            f"{name!r} made a {type(made).__name__}, which has no spec",
            hint="see vlafuzz.subjects.base.Subject",
        )
    return cast(Subject, made)
