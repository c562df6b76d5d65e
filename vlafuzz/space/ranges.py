"""Ranges as written in YAML: low, high, grid step, nominal value."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, model_validator

from vlafuzz.space.params import Grid

Number = Annotated[float, Field(allow_inf_nan=False)]
Step = Annotated[float, Field(ge=1e-6, allow_inf_nan=False)]  # values are rounded to nine decimals
Point = tuple[Number, Number]


class Strict(BaseModel):
    """Data from outside: unknown keys and quoted numbers are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class Span(Strict):
    """The values from ``low`` to ``high``."""

    low: Number
    high: Number
    step: Step

    @model_validator(mode="after")
    def _ordered(self) -> Span:
        if self.low > self.high:
            raise ValueError(f"low is above high: {self.low:g} > {self.high:g}")
        return self

    def grid(self, nominal: float) -> Grid:
        """Its levels, counted from a nominal value."""
        return Grid(self.low, self.high, self.step, nominal)

    def holds(self, value: float) -> bool:
        """Whether a value is inside."""
        return self.low <= value <= self.high


class Range(Span):
    """The values from ``low`` to ``high`` around a nominal one."""

    nominal: Number

    @model_validator(mode="after")
    def _around(self) -> Range:
        if not self.holds(self.nominal):
            raise ValueError(f"nominal {self.nominal:g} is not between {self.low:g} and {self.high:g}")
        return self


class Box(Strict):
    """A rectangle on the table, metres."""

    x: Span
    y: Span
