"""OperatorSet: the operators with their ranges, from YAML, narrowed by the user, kept in conditions."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import BaseModel, BeforeValidator, Field, ValidationError, create_model

from vlafuzz.common.assets import operators_dir
from vlafuzz.common.reading import first_problem, read_yaml
from vlafuzz.errors import CatalogueError, StoreError, UsageError, suggestion
from vlafuzz.model.conditions import Conditions, Setting, check_choice
from vlafuzz.worlds.manipulation.base import Box, Operator, Range, Strict, Visible
from vlafuzz.worlds.manipulation.extras import EVENTS, EXTRAS
from vlafuzz.worlds.manipulation.operators import OPERATORS, ConfounderCount

DEFAULT = "tabletop"
MIN_DISTANCE = Setting("min_distance", 0.0)  # between objects' centres, metres
VISIBLE = Setting("visible", "")  # bounds of visibility, as JSON; empty where that is not checked
TASKS = ("pick-up", "move-near", "put-on", "put-in")  # that may have ranges of their own in a file
_NO_OPERATORS = ("instructions", "libero-objects")
Kind = TypeVar("Kind", bound=Operator)
_Raw = dict[str, dict[str, Any]]
_Distance = Annotated[float, Field(ge=0, allow_inf_nan=False)]


class _TaskPart(Strict):
    min_distance: _Distance | None = None
    visible: Any = None  # bounds; False for no such check
    operators: _Raw = Field(default_factory=dict)


class _File(_TaskPart):
    extends: str | None = None
    vary: list[str] | None = None
    tasks: dict[str, _TaskPart] = Field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class OperatorSet:
    """All operators with their ranges, and which of them vary; the others stay nominal.

    Attributes:
        source: the file that was read.
        min_distance: between the centres of any two objects, metres.
        visible: None where it is not checked whether targets are visible.
        severity: by how much the ranges are scaled towards nominal, see ``Operators``.
        tasks: the sets of the tasks whose ranges differ.
    """

    source: Path
    min_distance: float
    operators: Mapping[str, Operator]
    varied: frozenset[str]
    visible: Visible | None = None
    tasks: Mapping[str, OperatorSet] = field(default_factory=dict)
    severity: float = 1.0

    def only(self, names: Iterable[str]) -> OperatorSet:
        """The same set with only these operators varying; a UsageError for one that is none, or has nothing to vary.

        ``events`` stands for all that happens in the middle of an episode.
        """
        varied = dict.fromkeys(name for given in names for name in (EVENTS if given == "events" else (given,)))
        for name in varied:
            check_choice("operator", name, OPERATORS)
        idle = [name for name in varied if name.startswith("confounder-") and name != ConfounderCount.name]
        if idle and ConfounderCount.name not in varied and self.get(ConfounderCount).nominal == 0:
            raise UsageError(
                f"{idle[0]}: there is no confounder to vary while {ConfounderCount.name} stays 0",
                hint=f"vary {ConfounderCount.name} as well, or give it another nominal value in a file",
            )
        tasks = {name: replace(part, varied=frozenset(varied)) for name, part in self.tasks.items()}
        return replace(self, varied=frozenset(varied), tasks=tasks)

    def in_task(self, task: str) -> OperatorSet:
        """The set for a task."""
        found = self.tasks.get(task, self)
        return found if found.severity == self.severity else replace(found, severity=self.severity)

    def get(self, kind: type[Kind]) -> Kind:
        """The operator of a kind."""
        operator = self.operators[kind.name]
        assert isinstance(operator, kind)
        return operator

    @cached_property
    def decisive(self) -> dict[str, Operator]:
        """The operators without extras that do not vary: those decide nothing."""
        return {
            name: operator for name, operator in self.operators.items() if name in self.varied or name not in EXTRAS
        }

    @property
    def conditions(self) -> dict[str, Any]:
        """The set as fields of ``Conditions``, by name."""
        world = {MIN_DISTANCE.name: self.min_distance, VISIBLE.name: visible_json(self.visible)}
        return {"world": world, "operators": operators_json(self), "operators_digest": self.digest}

    @cached_property
    def digest(self) -> str:
        """32 hexadecimal digits: equal for sets that vary the same operators in the same ranges."""
        parts = [f"{task}={part.digest}" for task, part in sorted(self.tasks.items())]
        ranges = [f"{name}={operator.model_dump_json()}" for name, operator in sorted(self.decisive.items())]
        scaled = [f"severity={self.severity!r}"] * (self.severity != 1)
        text = "\n".join([repr(self.min_distance), *sorted(self.varied), *ranges, *parts, *scaled])
        return hashlib.blake2b(text.encode(), digest_size=16).hexdigest()


def load_operators(source: str | Path | None = None) -> OperatorSet:
    """Read operators from a file, or shipped ones by name; a CatalogueError with file and key if they are wrong."""
    path = _find(str(source or DEFAULT), beside=None)
    return _make(path, _with_extras(_read(path, ())))


def _find(source: str, beside: Path | None) -> Path:
    shipped = {path.stem: path for path in operators_dir().glob("*.yaml") if path.stem not in _NO_OPERATORS}
    if source in shipped:
        return shipped[source]
    path = (beside.parent / source) if beside else Path(source)
    if not os.path.isfile(path):  # unlike path.is_file(), false for a name that is too long
        raise CatalogueError(f"operators: no file {str(path)!r}", hint=suggestion(source, shipped))
    return path


def _read(path: Path, extended: tuple[Path, ...]) -> _File:
    """A file, completed by the files that it extends."""
    if path.resolve() in extended:
        raise CatalogueError(f"{path}: extends: goes round in a circle")
    file = _validated(path, _File, read_yaml(path, CatalogueError))
    if file.extends is None:
        return file
    return _merged(_read(_find(file.extends, beside=path), (*extended, path.resolve())), file)


def _with_extras(file: _File) -> _File:
    """A file, with the shipped extras and bounds of visibility where it leaves them out."""
    complete = not EXTRAS - file.operators.keys() and file.visible is not None
    shipped = file if complete else _read(_find(DEFAULT, beside=None), ())
    extras = {name: keys for name, keys in shipped.operators.items() if name in EXTRAS}
    visible = shipped.visible if file.visible is None else file.visible
    return file.model_copy(update={"operators": extras | file.operators, "visible": visible})


def _merged(base: _File, file: _File) -> _File:
    tasks = {name: _overlaid(base.tasks.get(name, _TaskPart()), part) for name, part in file.tasks.items()}
    vary = base.vary if file.vary is None else file.vary
    return _File(**dict(_overlaid(base, file)), vary=vary, tasks=base.tasks | tasks)


def _overlaid(base: _TaskPart, over: _TaskPart) -> _TaskPart:
    nearest = base.min_distance if over.min_distance is None else over.min_distance
    visible = base.visible if over.visible is None else over.visible
    if isinstance(visible, dict) and isinstance(base.visible, dict):
        visible = base.visible | visible
    changed = {name: base.operators.get(name, {}) | keys for name, keys in over.operators.items()}
    return _TaskPart(min_distance=nearest, visible=visible, operators=base.operators | changed)


_Operators: Any = create_model("_Operators", __base__=Strict, **{name: (kind, ...) for name, kind in OPERATORS.items()})  # type: ignore[call-overload]


class _Part(Strict):
    """The ranges of a task, or of all others, complete."""

    min_distance: _Distance
    visible: Annotated[Visible | None, BeforeValidator(lambda bounds: None if bounds is False else bounds)]
    operators: _Operators

    def as_set(self, path: Path, varied: Iterable[str]) -> OperatorSet:
        ranges = {name: getattr(self.operators, name) for name in OPERATORS}
        distance, visible = self.min_distance, self.visible
        return OperatorSet(
            source=path, min_distance=distance, operators=ranges, varied=frozenset(varied), visible=visible
        )


class _Whole(_Part):
    tasks: dict[str, _Part]


def _make(path: Path, file: _File) -> OperatorSet:
    vary = [name for name in OPERATORS if name not in EXTRAS] if file.vary is None else file.vary
    for name in file.tasks:
        if name not in TASKS:
            raise CatalogueError(f"{path}: tasks: unknown name {name!r}", hint=suggestion(name, TASKS))
    parts = {name: _overlaid(file, part) for name, part in file.tasks.items()}
    written = file.model_copy(update={"tasks": parts}).model_dump(exclude={"extends", "vary"}, exclude_none=True)
    whole = _validated(path, _Whole, written)
    tasks = {name: part.as_set(path, vary) for name, part in whole.tasks.items()}
    try:
        return replace(whole.as_set(path, vary), tasks=tasks).only(vary)
    except UsageError as error:
        raise CatalogueError(f"{path}: vary: {error.message}", hint=error.hint) from None


S = TypeVar("S", bound=BaseModel)
_MODELS: tuple[type[BaseModel], ...] = (_File, _Operators, Visible, Box, Range, *OPERATORS.values())
_KEYS = {key for model in _MODELS for key in model.model_fields}


def _validated(path: Path, kind: type[S], raw: object) -> S:
    """Validate data as a model; a CatalogueError with file, key and value, and a suggestion for a misspelt key."""
    try:
        return kind.model_validate(raw)
    except ValidationError as error:
        problem = error
    for wrong in problem.errors(include_url=False):
        place = ".".join(map(str, wrong["loc"]))
        if wrong["type"] == "extra_forbidden":  # it explains a missing one
            hint = suggestion(str(wrong["loc"][-1]), _KEYS)
            raise CatalogueError(f"{path}: {place}: unknown key", hint=hint)
    first = problem.errors()[0]
    if first["type"] == "missing" and len(first["loc"]) < 3:
        hint = "`extends: tabletop` fills in what a file leaves out"
        raise CatalogueError(f"{path}: {'.'.join(map(str, first['loc']))}: missing", hint=hint)
    raise CatalogueError(
        f"{path}: {'' if first['loc'] else 'the file: '}{first_problem(problem)}",
        hint="operators/README.md says what each key means; `vlafuzz list operators` shows the ranges in use",
    )


def operators_json(operators: OperatorSet) -> str:
    """Operators with their ranges as a field of conditions."""
    ranges = {name: operator.model_dump(mode="json") for name, operator in operators.decisive.items()}
    kept = {"min_distance": operators.min_distance, "varied": sorted(operators.varied), "operators": ranges}
    scaled = {"severity": operators.severity} if operators.severity != 1 else {}
    return json.dumps(kept | scaled, sort_keys=True)


def stored_operators(source: Path, conditions: Conditions, vary: Collection[str] | None = None) -> OperatorSet:
    """The operators that ``operators_json`` wrote, of which those in ``vary`` vary, by default as then.

    ``source`` is the store or corpus, for messages.
    """
    try:
        stored = json.loads(conditions.operators)
        written = {
            name: kind.model_validate(stored["operators"][name])
            for name, kind in OPERATORS.items()
            if name in stored["operators"] or name not in EXTRAS
        }
        operators = OperatorSet(
            source=source,
            min_distance=stored["min_distance"],
            operators={**load_operators().operators, **written},
            varied=frozenset(stored["varied"]),
            visible=stored_visible(conditions),
            severity=float(stored.get("severity", 1.0)),
        )
    except (KeyError, ValueError, TypeError) as error:
        raise StoreError(
            f"{source}: its operators are those of another version: {' '.join(str(error).split())}",
            hint="use the version that began the run",
        ) from None
    return operators if vary is None else operators.only(vary)


def visible_json(visible: Visible | None) -> str:
    """Bounds of visibility as a field of conditions."""
    return visible.model_dump_json() if visible else ""


def stored_visible(conditions: Conditions) -> Visible | None:
    """The bounds that ``visible_json`` wrote; a ValueError if another version did."""
    kept = VISIBLE.of(conditions)
    return Visible.model_validate_json(kept) if kept else None
