"""Parameters: the values by name that a reset takes, with their ranges, in Python or in a file.

A file says the same as ``Parameter``, with names as keys::

    length: {range: [0.25, 1.5], nominal: 0.5, unit: m, says: how long the pole is}
    boxes: {kind: integer, range: [0, 4], nominal: 1}
    floor: {options: [wood, ice], says: what it stands on}
    heading: {kind: angle, nominal: 0, unit: °}
"""

import hashlib
import json
import math
import re
from collections.abc import Collection, Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter

from vlafuzz.common.reading import read_yaml, validated
from vlafuzz.errors import CatalogueError, UsageError
from vlafuzz.model import Gene, Grid
from vlafuzz.model.scene import UNITS, Real, Text

Kind = Literal["real", "integer", "angle"]
Value = float | str
PREFIX = "values."  # of a gene's path
LEVELS = 40  # of a range, at least, where a file says no step: 1, 2 or 5 in the last digit
_NAME = re.compile(r"[a-z][a-z0-9_-]*")
_LATER = ("kind", "unit", "group", "sets")  # left out of stored ranges at their defaults, which keeps older ones equal


@dataclass(frozen=True)
class Parameter:
    """One value that a reset takes.

    Args:
        name: lower-case letters, digits, dashes and underscores.
        step: of the grid; values of a scene are nominal plus a whole number of steps.
        options: of a value that is a text, the nominal one first, in place of the numbers.
        says: what it changes, in a few words.
        kind: ``integer`` for whole numbers, ``angle`` for degrees on the whole circle.
        unit: written behind the number.
        group: the operator that it is part of; parameters of one group vary, and are reset, together.
        sets: what it sets in an environment of gymnasium, see ``GymWorld.apply``.

    Raises:
        UsageError: the numbers are no range with nominal in it.
    """

    name: str
    low: float = 0.0
    high: float = 0.0
    nominal: float = 0.0
    step: float = 1.0
    options: tuple[str, ...] = ()
    says: str = ""
    kind: Kind = "real"
    unit: str = ""
    group: str = ""
    sets: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not _NAME.fullmatch(self.name) or not _NAME.fullmatch(self.operator):
            hint = "lower-case letters, digits, dashes and underscores"
            raise UsageError(f"parameter {self.name!r}, group {self.group!r}: no such names", hint)
        if not self.options and not self.low <= self.nominal <= self.high:
            problem = f"parameter {self.name}: nominal {self.nominal:g} is not within {self.low:g} to {self.high:g}"
            raise UsageError(problem, hint="a range has the usual value in it")
        if not self.options and not (self.step > 0 and self.low < self.high):
            problem = f"parameter {self.name}: {self.low:g} to {self.high:g} in steps of {self.step:g} is no range"
            raise UsageError(problem, hint="low is below high, and the step positive")
        if self.unit:
            UNITS[PREFIX + self.name] = self.unit if self.unit in ("°", "×", "%") else f" {self.unit}"

    @property
    def operator(self) -> str:
        """The name under which it varies, and is reset."""
        return self.group or self.name

    @property
    def gene(self) -> Gene:
        path = PREFIX + self.name
        if self.options:
            return Gene(self.operator, path, "category", Grid.choice(len(self.options)), options=self.options)
        grid = Grid(self.low, self.high, self.step, self.nominal, wraps=self.kind == "angle")
        return Gene(self.operator, path, "angle" if self.kind == "angle" else "real", grid)

    def told(self, number: float) -> Value:
        """The value that a reset gets for a gene's number."""
        if self.options:
            return self.options[int(number)]
        return round(number) if self.kind == "integer" else float(number)

    def number(self, value: Value | None) -> float:
        """A gene's number for a value; nominal where there is none, NaN where no gene can express it."""
        if value is None:
            return 0.0 if self.options else self.nominal
        if self.options:
            return float(self.options.index(value)) if value in self.options else math.nan
        return float(value) if isinstance(value, int | float) else math.nan


@dataclass(frozen=True)
class Parameters:
    """The parameters of a world by name, and which operators of them vary: the ``Operators`` of its space."""

    parameters: Mapping[str, Parameter]
    varied: frozenset[str]
    severity: float = 1.0

    @cached_property
    def operators(self) -> dict[str, list[Parameter]]:
        return operators_of(self.parameters.values())

    @property
    def decisive(self) -> Collection[str]:
        return self.operators

    @cached_property
    def digest(self) -> str:
        return hashlib.blake2b(self.to_json().encode(), digest_size=16).hexdigest()

    def to_json(self) -> str:
        """The parameters as conditions keep them."""
        ranges = {name: _stored(parameter) for name, parameter in self.parameters.items()}
        scaled = {"severity": self.severity} if self.severity != 1 else {}
        return json.dumps({"varied": sorted(self.varied), "operators": ranges} | scaled, sort_keys=True)


def operators_of(parameters: Collection[Parameter]) -> dict[str, list[Parameter]]:
    """The parameters by the operator under which they vary."""
    return {name: [one for one in parameters if one.operator == name] for name in (one.operator for one in parameters)}


def read_parameters(path: Path) -> tuple[Parameter, ...]:
    """The parameters of a YAML file; a CatalogueError with file and key if it is wrong."""
    hint = "a text with a comma needs quotation marks"
    entries = validated(_FILE, read_yaml(path, CatalogueError), path, CatalogueError, hint)
    try:
        return tuple(entry.parameter(name) for name, entry in entries.items())
    except UsageError as error:
        raise CatalogueError(f"{path}: {error.message}", error.hint) from None


class _Entry(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)
    range: tuple[Real, Real] | None = None
    nominal: Real | None = None
    step: Annotated[Real, Field(gt=0)] | None = None
    options: tuple[Text, ...] = ()
    kind: Literal["real", "integer", "angle", "category"] = "real"
    says: Text = ""
    unit: Text = ""
    group: Text = ""
    sets: Text | tuple[Text, ...] = ()

    def parameter(self, name: str) -> Parameter:
        said = self.model_dump(include={"says", "unit", "group"})
        said["sets"] = (self.sets,) if isinstance(self.sets, str) else self.sets
        if self.options or self.kind == "category":
            if len(self.options) < 2 or self.range or self.nominal is not None:
                problem = f"{name}: a category has two or more options and no numbers"
                raise UsageError(problem, hint="the first option is the nominal one")
            return Parameter(name, options=self.options, **said)
        circle = (-180.0, 180.0) if self.kind == "angle" else None
        span = self.range or circle
        if span is None or self.nominal is None:
            raise UsageError(f"{name}: it has no range or no nominal value", hint="range: [0.5, 2], nominal: 1")
        if circle and span != circle:
            hint = "leave kind out: a part of the circle is a range as any other"
            raise UsageError(f"{name}: an angle goes from -180 to 180, not {span[0]:g} to {span[1]:g}", hint)
        step = self.step or (1.0 if self.kind == "integer" else _usual_step(*span))
        return Parameter(name, *span, nominal=self.nominal, step=step, kind=self.kind, **said)


_FILE = TypeAdapter(dict[str, _Entry])


def _usual_step(low: float, high: float) -> float:
    finest = max(high - low, 1e-9) / LEVELS
    power = 10.0 ** math.floor(math.log10(finest))
    return round(max(factor * power for factor in (1, 2, 5) if factor * power <= finest * (1 + 1e-9)), 9)


def _stored(one: Parameter) -> dict[str, Any]:
    defaults = Parameter(one.name, -1.0, 1.0)
    return {key: value for key, value in asdict(one).items() if key not in _LATER or value != getattr(defaults, key)}
