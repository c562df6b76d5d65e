"""Operator, what all scene operators have in common, and its ranges as written in YAML."""

from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, ClassVar, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from vlafuzz.model import Gene, Grid
from vlafuzz.model.genes import Kind
from vlafuzz.model.scene import Real
from vlafuzz.worlds.manipulation.rigs import Rig

Number = Real  # a scene takes no others
Step = Annotated[Real, Field(ge=1e-6)]  # values are rounded to nine decimals
MOST_LEVELS = 100_000  # of a range: all of them are kept


class Strict(BaseModel):
    """Data from outside: unknown keys and quoted numbers are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


def check_levels(low: float, high: float, step: float) -> None:
    """Raise a ValueError for a step that is too small for its range."""
    if high - low > MOST_LEVELS * step:
        raise ValueError(f"a step of {step:g} from {low:g} to {high:g} gives over {MOST_LEVELS} values")


class Span(Strict):
    """The values from ``low`` to ``high``."""

    low: Number
    high: Number
    step: Step

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.low > self.high:
            raise ValueError(f"low is above high: {self.low:g} > {self.high:g}")
        check_levels(self.low, self.high, self.step)
        return self

    def __str__(self) -> str:
        return f"{self.low:g} to {self.high:g}"

    def grid(self, nominal: float) -> Grid:
        """Its levels, counted from a nominal value."""
        return Grid(self.low, self.high, self.step, nominal)

    def holds(self, value: float) -> bool:
        return self.low <= value <= self.high


class Range(Span):
    """The values from ``low`` to ``high`` around a nominal one."""

    nominal: Number

    @model_validator(mode="after")
    def _around(self) -> Self:
        if not self.holds(self.nominal):
            raise ValueError(f"nominal {self.nominal:g} is not between {self.low:g} and {self.high:g}")
        return self


class Box(Strict):
    """A rectangle on the table, metres."""

    x: Span
    y: Span


@dataclass(frozen=True)
class Layout:
    """The slots of a task's scenes.

    Attributes:
        slots: by slot, such as ``targets.0``, the names allowed there; ``nominal``: the index of one of them.
        stable_poses: the largest number of stable poses of one object.
    """

    slots: dict[str, tuple[str, ...]]
    nominal: dict[str, int]
    stable_poses: int
    wordings: int
    rig: Rig

    def of(self, part: str) -> list[str]:
        """The slots of the ``targets`` or the ``confounders``."""
        return [slot for slot in self.slots if slot.startswith(part)]

    def used(self, confounders: int) -> list[str]:
        """The slots of the targets, then those of so many confounders."""
        return [*self.of("targets"), *self.of("confounders")[:confounders]]


class Operator(Strict):
    """One way in which a scene can vary: its ranges, under the ``name`` that users know.

    ``says`` describes it; its fields complete ``nominal_text`` and ``range_text``. ``part``: of the scene.
    """

    name: ClassVar[str]
    says: ClassVar[str]
    part: ClassVar[str]
    nominal_text: ClassVar[str]
    range_text: ClassVar[str]

    @abstractmethod
    def genes(self, layout: Layout) -> Iterator[Gene]:
        """The operator's genes, slot by slot."""

    def ranges(self) -> str:
        return self.range_text.format_map(dict(self))

    def nominally(self) -> str:
        return self.nominal_text.format_map(dict(self))

    def _gene(self, path: str, kind: Kind, grid: Grid) -> Gene:
        return Gene(self.name, path, kind, grid)


Share = Annotated[float, Field(ge=0, le=1)]
Levels = Annotated[float, Field(ge=0, le=255)]


class Visible(Strict):
    """Bounds within which a target counts as visible: the least that must be seen of it.

    Attributes:
        inside: share of its outline in the picture; ``unhidden``: share of that which nothing hides. area: share of the
        picture that is seen of it, and that is apart.
        apart: difference from its surroundings, of 255 grey levels; ``apart_in_outlines``: for policies that get
            outlines in flat colours.
    """

    inside: Share
    unhidden: Share
    area: Share
    apart: Levels
    apart_in_outlines: Levels

    def __str__(self) -> str:
        """The bounds in words, without those for outlines."""
        outline = f"{self.inside:.0%} of its outline in the picture, {self.unhidden:.0%} of that not hidden"
        return f"{outline}, {self.area:.2%} of the picture and {self.apart:g}/255 apart from its surroundings"
