"""Scene embedding: vectors whose distance measures difference, for nearest neighbours and learning."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from vlafuzz.space.compose import camera
from vlafuzz.space.operators import CameraPosition
from vlafuzz.space.params import Gene

Vector = NDArray[np.float64]


class SceneEmbedding:
    """Maps values to vectors of fixed length.

    Two scenes that differ in a single operator are at most 1 apart, whichever operator it is. Numbers are
    centred, so that zero, which stands for an unused slot, is equally far from both ends of a range. Angles
    are points on a circle, categories are one-hot, the camera's position is a point in space.
    """

    def __init__(self, genes: Sequence[Gene]) -> None:
        self._genes = tuple(gene for gene in genes if gene.operator != CameraPosition.name)
        moved = [gene for gene in genes if gene.path == "camera.distance"]
        self._farthest = moved[0].grid.high if moved else 0.0
        count = Counter(gene.operator for gene in self._genes)
        self._weights = {name: 1 / math.sqrt(number) for name, number in count.items()}

    def vector(self, values: Mapping[str, float]) -> Vector:
        """``(length,)`` embedding of the values of a scene; genes without a value give zeros."""
        numbers: list[float] = []
        for gene in self._genes:
            weight = self._weights[gene.operator]
            numbers += [weight * number for number in _numbers(gene, values.get(gene.path))]
        if self._farthest:
            numbers += [number / (2 * self._farthest) for number in camera(values).offset]
        return np.array(numbers)


def _numbers(gene: Gene, value: float | None) -> Iterator[float]:
    """A value as numbers at most 1 away from those of any other value; zeros for no value."""
    missing = value is None or math.isnan(value)
    if gene.kind == "category":
        yield from (math.sqrt(0.5) * (index == value) for index in range(gene.grid.size))
    elif gene.kind == "angle":
        yield 0.0 if missing else math.sin(math.radians(value or 0.0)) / 2
        yield 0.0 if missing else math.cos(math.radians(value or 0.0)) / 2
    else:
        yield 0.0 if missing else gene.grid.share(value or 0.0) - 0.5
