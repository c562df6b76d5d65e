"""Operator and Extra: what all scene operators have in common."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar

from pydantic import model_validator

from vlafuzz.rigs.rig import Rig
from vlafuzz.scene import EXTRAS, in_words
from vlafuzz.space.params import Gene, Grid, Kind
from vlafuzz.space.ranges import Span, Strict


@dataclass(frozen=True)
class Layout:
    """The slots of a task's scenes.

    Attributes:
        slots: the allowed object names of each slot, such as ``targets.0``.
        nominal: the index of each slot's nominal name.
        stable_poses: the largest number of stable poses of one object.
        wordings: the number of wordings of the instruction.
        rig: the robot at its table.
    """

    slots: dict[str, tuple[str, ...]]
    nominal: dict[str, int]
    stable_poses: int
    wordings: int
    rig: Rig

    def of(self, part: str) -> list[str]:
        """The slots of the ``targets`` or the ``confounders``."""
        return [slot for slot in self.slots if slot.startswith(part)]


class Operator(Strict):
    """One way in which a scene can vary. ``name`` is for users to refer to it, ``says`` describes it."""

    name: ClassVar[str]
    says: ClassVar[str]

    @abstractmethod
    def genes(self, layout: Layout) -> Iterator[Gene]:
        """The operator's genes, slot by slot."""

    @abstractmethod
    def ranges(self) -> str:
        """The ranges in words."""

    @abstractmethod
    def nominally(self) -> str:
        """The nominal value in words."""

    def _gene(self, path: str, kind: Kind, grid: Grid) -> Gene:
        return Gene(self.name, path, kind, grid)


Options = Span | tuple[str, ...]


class Extra(Operator):
    """An operator that is off by default. It varies the fields of one ``part`` of the scene.

    Each of its own fields has the name of a field of that part, and is its range or the options to choose
    from. Nominal is the default of the part's field. While the operator does not vary, digests of operator
    sets and stored operators leave it out; a file that leaves it out gets the ranges of ``tabletop.yaml``.
    """

    part: ClassVar[str]

    def spans(self, rig: Rig) -> Mapping[str, Options]:
        """The range of each field that this rig has."""
        return self._spans

    def genes(self, layout: Layout) -> Iterator[Gene]:
        for field, span in self.spans(layout.rig).items():
            path, nominal = f"{self.part}.{field}", getattr(EXTRAS[self.part], field)
            if isinstance(span, Span):
                yield self._gene(path, "real", span.grid(nominal))
            else:
                grid = Grid.choice(len(span), span.index(nominal))
                yield Gene(self.name, path, "category", grid, options=span)

    def nominally(self) -> str:
        return ", ".join(in_words(field, getattr(EXTRAS[self.part], field)) for field in self._spans)

    def ranges(self) -> str:
        return ", ".join(
            f"{field} {span.low:g} to {in_words(field, span.high).removeprefix(field + ' ')}"
            if isinstance(span, Span)
            else f"{field} {' or '.join(span)}"
            for field, span in self._spans.items()
        )

    @model_validator(mode="after")
    def _has_nominal(self) -> Extra:
        for field, span in self._spans.items():
            nominal = getattr(EXTRAS[self.part], field)
            if not (span.holds(nominal) if isinstance(span, Span) else nominal in span):
                raise ValueError(f"{field} does not include {nominal}, its nominal value")
            if isinstance(nominal, int) and isinstance(span, Span) and span.step % 1:
                raise ValueError(f"{field} is a whole number, its step is {span.step:g}")
        return self

    @property
    def _spans(self) -> dict[str, Options]:
        return {field: getattr(self, field) for field in type(self).model_fields}
