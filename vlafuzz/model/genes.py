"""Gene: one coordinate of a scene on a grid of levels. Categories and counts are numbers, too."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, replace
from functools import cached_property
from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray

Genome = NDArray[np.float64]  # (d,) in [0, 1]
Kind = Literal["category", "real", "angle", "count"]
Spread = Literal["even", "coin", "sphere"]


@dataclass(frozen=True)
class Grid:
    """The values ``nominal + k * step`` between ``low`` and ``high``; their indices are the levels.

    Attributes:
        log: ``step`` is one of log2 of the value.
        wraps: both ends are the same angle; only the upper one is a level.
    """

    low: float
    high: float
    step: float
    nominal: float
    _: KW_ONLY
    log: bool = False
    wraps: bool = False

    @staticmethod
    def choice(size: int, nominal: int = 0) -> "Grid":
        """One of ``size`` options, by index."""
        return Grid(0, size - 1, 1, nominal)

    def narrowed(self, share: float) -> Self:
        """The same grid with both ends so much nearer to nominal, at the nearest levels."""
        start = self._scaled(self.nominal)
        ends = (start + self.step * round(share * self._steps(end)) for end in (self.low, self.high))
        low, high = (2.0**end if self.log else end for end in ends)
        return replace(self, low=low, high=high, wraps=False)

    @cached_property
    def size(self) -> int:
        return math.floor(self._steps(self.high) + 1e-9) - self._first + 1

    @property
    def nominal_level(self) -> int:
        return -self._first

    def value(self, level: int) -> float:
        return self._values[level]

    @cached_property
    def _values(self) -> tuple[float, ...]:
        start = self._scaled(self.nominal)
        scaled = [round(start + (level + self._first) * self.step, 9) + 0.0 for level in range(self.size)]
        # Short floats: equal on every machine. But nominal is what the user wrote, with all its decimals.
        values = [float(f"{2.0**exponent:.6g}") for exponent in scaled] if self.log else scaled
        values[self.nominal_level] = self.nominal
        return tuple(values)

    def snap(self, value: float) -> int:
        """The level nearest to a value."""
        level = round(self._steps(min(max(value, self.low), self.high))) - self._first
        return min(max(level, 0), self.size - 1)

    def clipped(self, value: float) -> float:
        """The same value if it is in the range, on the grid or not, else the level at the nearest end."""
        low, high = min(self.low, self.value(0)), max(self.high, self.value(self.size - 1))
        return value if low <= value <= high else self.value(self.snap(value))

    def level(self, value: float) -> int | None:
        """The level with exactly this value, or None."""
        if not math.isfinite(value) or (self.log and value <= 0):
            return None
        level = self.snap(value)
        return level if self.value(level) == value else None

    def share(self, value: float) -> float:
        """The position of a value between the ends of the range, in [0, 1]."""
        if math.isnan(value) or self.high == self.low:
            return 0.5
        low, high = self._scaled(self.low), self._scaled(self.high)
        return (self._scaled(min(max(value, self.low), self.high)) - low) / (high - low)

    def distance(self, value: float) -> float:
        """The distance of a value from nominal, as a share of the greatest in the range: in [0, 1]."""
        if math.isnan(value) or (self.log and value <= 0):
            return 1.0
        centre = self._scaled(self.nominal)
        away = abs(self._scaled(value) - centre)
        if self.wraps:
            return abs((away + 180.0) % 360.0 - 180.0) / 180.0
        farthest = max(centre - self._scaled(self.low), self._scaled(self.high) - centre)
        return min(away / farthest, 1.0) if farthest > 0 else float(away > 0)

    @cached_property
    def _first(self) -> int:
        return math.ceil(self._steps(self.low) - 1e-9) + self.wraps

    def _steps(self, value: float) -> float:
        return (self._scaled(value) - self._scaled(self.nominal)) / self.step

    def _scaled(self, value: float) -> float:
        return math.log2(value) if self.log else float(value)


@dataclass(frozen=True)
class Gene:
    """One coordinate.

    Attributes:
        operator: the name of its operator.
        path: where its value stands in a scene, such as ``targets.0.x``.
        neutral: no value is more severe than another, as for a direction.
        options: of a category whose values are strings in the scene.
        spread: how random generation draws it: ``even`` over the levels; ``coin``, a fair coin for below or above 1,
            then linearly (the paper's light); ``sphere``, the elevation of a uniform direction.
        drawn: of a category, how often it is drawn at all; else it is nominal.
    """

    operator: str
    path: str
    kind: Kind
    grid: Grid
    _: KW_ONLY
    neutral: bool = False
    options: tuple[str, ...] = ()
    spread: Spread = "even"
    drawn: float = 1.0

    def narrowed(self, share: float) -> Self:
        """The gene with its range scaled towards nominal; a category is drawn that much less often."""
        if share == 1 or self.neutral:
            return self
        return replace(self, drawn=share) if self.kind == "category" else replace(self, grid=self.grid.narrowed(share))

    @property
    def slot(self) -> str:
        """The part of the scene it belongs to: ``targets.0``, ``confounders.2``, ``camera``, or empty."""
        return self.path.rpartition(".")[0]

    def draw(self, rng: np.random.Generator) -> float:
        """A random value on the grid."""
        grid = self.grid
        if self.drawn < 1 and rng.random() >= self.drawn:
            return grid.nominal
        if self.spread == "coin":
            side = (grid.low, 1.0) if rng.random() < 0.5 else (1.0, grid.high)
            return grid.value(grid.snap(float(rng.uniform(*side))))
        if self.spread == "sphere":
            return grid.value(grid.snap(math.degrees(math.asin(rng.uniform(-1.0, 1.0)))))
        return grid.value(int(rng.integers(grid.size)))

    def distance(self, value: float) -> float:
        """The distance of a value from nominal, in [0, 1]; for categories 0 or 1."""
        if self.neutral:
            return 0.0
        return float(value != self.grid.nominal) if self.kind == "category" else self.grid.distance(value)


def embedded(genes: Sequence[Gene], values: Mapping[str, float]) -> list[float]:
    """The embedding of the values of a scene; genes without a value give zeros.

    Two scenes that differ in a single operator are at most 1 apart. Numbers are centred, so that zero, for an unused
    slot, is equally far from both ends of a range. Angles are on a circle, categories one-hot.
    """
    count = Counter(gene.operator for gene in genes)
    numbers: list[float] = []
    for gene in genes:
        weight = 1 / math.sqrt(count[gene.operator])
        numbers += [weight * number for number in _numbers(gene, values.get(gene.path, math.nan))]
    return numbers


def _numbers(gene: Gene, value: float) -> list[float]:
    """A value as numbers at most 1 away from those of any other value; zeros for no value."""
    if gene.kind == "category":
        return [math.sqrt(0.5) * (index == value) for index in range(gene.grid.size)]
    if math.isnan(value):
        return [0.0, 0.0] if gene.kind == "angle" else [0.0]
    if gene.kind == "angle":
        return [math.sin(math.radians(value)) / 2, math.cos(math.radians(value)) / 2]
    return [gene.grid.share(value) - 0.5]
