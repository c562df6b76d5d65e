"""Subjects by name."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import cast

from vlafuzz.errors import UsageError, suggestion
from vlafuzz.plugins import is_reference, load_factory, make_of
from vlafuzz.subjects.act import Act
from vlafuzz.subjects.base import Subject, SubjectSpec
from vlafuzz.subjects.controls import Frozen, Random
from vlafuzz.subjects.expert import Expert
from vlafuzz.subjects.groot import Groot
from vlafuzz.subjects.lerobot import LeRobot
from vlafuzz.subjects.openpi import OpenPi
from vlafuzz.subjects.pinhole import Pinhole
from vlafuzz.subjects.remote import Remote, parse
from vlafuzz.subjects.vla_eval import VlaEval


def _mini() -> Subject:
    """A small learned policy that sees a picture, reads the instruction and acts; on a CPU."""
    from vlafuzz.subjects.mini.subject import Mini  # loads torch

    return Mini()


SUBJECTS: dict[str, Callable[[], Subject]] = {
    "mini": _mini,
    "pinhole": Pinhole,
    "expert": Expert,
    "random": Random,
    "frozen": Frozen,
}
# Behind a model server, by the protocol that it speaks; named as protocol:address, HTTP by the address alone.
SERVERS: dict[str, type[Remote]] = {
    "vla-eval": VlaEval,
    "openpi": OpenPi,
    "http": Act,
    "groot": Groot,
    "lerobot": LeRobot,  # no server, but named like one
}


def known_subjects() -> dict[str, str]:
    """What there is: name → what it is, in a sentence."""
    named = SUBJECTS | {kind.form: kind for kind in SERVERS.values()}
    return {
        name: (inspect.getdoc(factory) or "").split("\n\n")[0].replace("\n", " ")
        for name, factory in named.items()
    }


def check_subject_name(name: str) -> None:
    """Fail early for a name that ``make_subject`` would not know. Connects to no server.

    Raises:
        UsageError: no such subject.
    """
    if is_reference(name):
        load_factory(name)
    elif kind := _server(name):
        parse(name, kind)
    elif kind := SERVERS.get(name):
        raise UsageError(f"unknown subject {name!r}: no address", hint=f"expected {kind.form}?option=value&…")
    elif name not in SUBJECTS:
        near = suggestion(name.partition(":")[0], [*SUBJECTS, *SERVERS])
        raise UsageError(f"unknown subject {name!r}", hint=f"{near} your own: python:pkg.mod:factory")


def is_shared(name: str) -> bool:
    """Whether all workers share one subject of that name: see ``Subject``. Makes none.

    Raises:
        UsageError: no such subject.
    """
    check_subject_name(name)
    factory = load_factory(name) if is_reference(name) else _server(name) or SUBJECTS[name]
    return bool(getattr(factory, "shared", False))


def make_subject(name: str) -> Subject:
    """The subject of that name.

    Raises:
        UsageError: no such subject, or a factory that makes something else.
        PrerequisiteError: no server answers, or the user's own code raises.
    """
    check_subject_name(name)
    if kind := _server(name):
        return kind(parse(name, kind))
    if not is_reference(name):
        return SUBJECTS[name]()
    made = make_of(name)
    if not isinstance(getattr(made, "spec", None), SubjectSpec):
        raise UsageError(
            f"{name!r} made a {type(made).__name__}, which has no spec",
            hint="see vlafuzz.subjects.base.Subject",
        )
    return cast(Subject, made)


def _server(name: str) -> type[Remote] | None:
    protocol, colon, _ = name.partition(":")
    return SERVERS.get("http" if protocol == "https" else protocol) if colon else None
