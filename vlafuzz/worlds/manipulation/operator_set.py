"""OperatorSet: the operators with their ranges, from YAML, narrowed by the user, kept in conditions."""

import hashlib
import json
import os
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Self, TypeVar

from pydantic import BaseModel, BeforeValidator, Field, ValidationError, create_model

from vlafuzz.common.assets import operators_dir
from vlafuzz.common.reading import first_problem, read_yaml
from vlafuzz.errors import CatalogueError, StoreError, UsageError, suggestion
from vlafuzz.model import Conditions, Setting
from vlafuzz.model.conditions import check_choice
from vlafuzz.worlds.manipulation.base import Box, Operator, Range, Strict, Visible
from vlafuzz.worlds.manipulation.extras import EVENTS, EXTRAS
from vlafuzz.worlds.manipulation.operators import OPERATORS, ConfounderCount

DEFAULT = "tabletop"
MIN_DISTANCE = Setting("min_distance", 0.0)  # between objects' centres, metres
VISIBLE = Setting("visible", "")  # bounds of visibility, as JSON; empty where that is not checked
TASKS = ("pick-up", "move-near", "put-on", "put-in")  # that may have ranges of their own in a file
_NO_OPERATORS = ("instructions", "libero-objects")
_KEYS_SAID = "operators/README.md says what each key means; `vlafuzz list operators` shows the ranges in use"
Kind = TypeVar("Kind", bound=Operator)


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
    tasks: Mapping[str, "OperatorSet"] = field(default_factory=dict)
    severity: float = 1.0

    def only(self, names: Iterable[str]) -> Self:
        """The same set with only these operators varying; a UsageError for one that is none, or has nothing to vary.

        ``events`` stands for all that happens in the middle of an episode.
        """
        varied = dict.fromkeys(name for given in names for name in (EVENTS if given == "events" else (given,)))
        for name in varied:
            check_choice("operator", name, OPERATORS)
        idle = [one for one in varied if one.startswith(("confounder-", "newcomer")) and one != ConfounderCount.name]
        if idle and ConfounderCount.name not in varied and self.get(ConfounderCount).nominal == 0:
            problem = f"{idle[0]}: there is no confounder to vary while {ConfounderCount.name} stays 0"
            hint = f"vary {ConfounderCount.name} as well, or give it another nominal value in a file"
            raise UsageError(problem, hint)
        tasks = {name: replace(part, varied=frozenset(varied)) for name, part in self.tasks.items()}
        return replace(self, varied=frozenset(varied), tasks=tasks)

    def in_task(self, task: str) -> "OperatorSet":
        found = self.tasks.get(task, self)
        return found if found.severity == self.severity else replace(found, severity=self.severity)

    def get(self, kind: type[Kind]) -> Kind:
        operator = self.operators[kind.name]
        assert isinstance(operator, kind)
        return operator

    @cached_property
    def decisive(self) -> dict[str, Operator]:
        """The operators without extras that do not vary: those decide nothing."""
        return {name: one for name, one in self.operators.items() if name in self.varied or name not in EXTRAS}

    @property
    def conditions(self) -> dict[str, Any]:
        """The set as fields of ``Conditions``, by name; ``stored_operators`` reads them."""
        visible = self.visible.model_dump_json() if self.visible else ""
        ranges = {name: operator.model_dump(mode="json") for name, operator in self.decisive.items()}
        kept = {"min_distance": self.min_distance, "varied": sorted(self.varied), "operators": ranges}
        scaled = {"severity": self.severity} if self.severity != 1 else {}
        return {
            "world": {MIN_DISTANCE.name: self.min_distance, VISIBLE.name: visible},
            "operators": json.dumps(kept | scaled, sort_keys=True),
            "operators_digest": self.digest,
        }

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
    file = _whole(_read(path, ()))
    written = _validated(path, file)
    vary = [name for name in OPERATORS if name not in EXTRAS] if written.vary is None else written.vary
    for name in written.tasks:
        if name not in TASKS:
            raise CatalogueError(f"{path}: tasks: unknown name {name!r}", hint=suggestion(name, TASKS))
    tasks = {name: part.as_set(path, vary) for name, part in written.tasks.items()}
    try:
        return replace(written.as_set(path, vary), tasks=tasks).only(vary)
    except UsageError as error:
        raise CatalogueError(f"{path}: vary: {error.message}", hint=error.hint) from None


def _find(source: str, beside: Path | None) -> Path:
    shipped = {path.stem: path for path in operators_dir().glob("*.yaml") if path.stem not in _NO_OPERATORS}
    if source in shipped:
        return shipped[source]
    path = (beside.parent / source) if beside else Path(source)
    if not os.path.isfile(path):  # unlike path.is_file(), false for a name that is too long
        raise CatalogueError(f"operators: no file {str(path)!r}", hint=suggestion(source, shipped))
    return path


def _read(path: Path, extended: tuple[Path, ...]) -> Any:
    """What a file says, completed by the files that it extends; nothing of it is checked."""
    if path.resolve() in extended:
        raise CatalogueError(f"{path}: extends: goes round in a circle")
    file = read_yaml(path, CatalogueError, _KEYS_SAID)
    if not isinstance(file, dict) or "extends" not in file:
        return file
    base = _read(_find(str(file.pop("extends")), beside=path), (*extended, path.resolve()))
    return _overlaid(base, file)


def _overlaid(base: Any, over: Any) -> Any:
    """Data with the keys of ``over`` in place of its own, at every level."""
    if not (isinstance(base, dict) and isinstance(over, dict)):
        return over
    return base | {key: _overlaid(base.get(key), value) for key, value in over.items()}


def _whole(file: Any) -> Any:
    """A file with the shipped extras and bounds of visibility where it leaves them out, and its tasks complete."""
    if not isinstance(file, dict):
        return file
    shipped = read_yaml(_find(DEFAULT, beside=None), CatalogueError)
    extras = {name: keys for name, keys in shipped["operators"].items() if name in EXTRAS}
    file = _overlaid({"operators": extras, "visible": shipped["visible"]}, file)
    tasks, common = file.get("tasks", {}), {key: file[key] for key in file.keys() & _Part.model_fields.keys()}
    if isinstance(tasks, dict):
        tasks = {name: _overlaid(common, part) for name, part in tasks.items()}
    return file | {"tasks": tasks}


_Operators: Any = create_model("_Operators", __base__=Strict, **{name: (kind, ...) for name, kind in OPERATORS.items()})  # type: ignore[call-overload]


class _Part(Strict):
    """The ranges of a task, or of all others, complete. ``visible`` is False where that is not checked."""

    min_distance: Annotated[float, Field(ge=0, allow_inf_nan=False)]
    visible: Annotated[Visible | None, BeforeValidator(lambda bounds: None if bounds is False else bounds)]
    operators: _Operators

    def as_set(self, path: Path, varied: Iterable[str]) -> OperatorSet:
        ranges = {name: getattr(self.operators, name) for name in OPERATORS}
        distance, visible = self.min_distance, self.visible
        return OperatorSet(
            source=path, min_distance=distance, operators=ranges, varied=frozenset(varied), visible=visible
        )


class _Whole(_Part):
    vary: list[str] | None = None
    tasks: dict[str, _Part]


_MODELS: tuple[type[BaseModel], ...] = (_Whole, _Operators, Visible, Box, Range, *OPERATORS.values())
_KEYS = {"extends", *(key for model in _MODELS for key in model.model_fields)}


def _validated(path: Path, raw: object) -> _Whole:
    """Validate a whole file; a CatalogueError with file, key and value, and a suggestion for a misspelt key."""
    try:
        return _Whole.model_validate(raw)
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
    where = "" if first["loc"] else "the file: "
    raise CatalogueError(f"{path}: {where}{first_problem(problem)}", hint=_KEYS_SAID)


def stored_operators(source: Path, conditions: Conditions, vary: Collection[str] | None = None) -> OperatorSet:
    """The operators of stored conditions, of which those in ``vary`` vary, by default as then.

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
        problem = f"{source}: its operators are those of another version: {' '.join(str(error).split())}"
        raise StoreError(problem, hint="use the version that began the run") from None
    return operators if vary is None else operators.only(vary)


def stored_visible(conditions: Conditions) -> Visible | None:
    """The bounds of visibility of stored conditions; a ValueError if another version wrote them."""
    kept = VISIBLE.of(conditions)
    return Visible.model_validate_json(kept) if kept else None
