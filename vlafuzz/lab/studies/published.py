"""The VLATest paper's figures as rows, from published/*.csv; each file names its source."""

import csv
from dataclasses import dataclass
from typing import TypeVar

from pydantic import TypeAdapter, ValidationError

from vlafuzz.common.assets import published_dir
from vlafuzz.errors import CatalogueError


@dataclass(frozen=True)
class Coverage:
    """Trajectory coverage: share of the cells that the first ``scenes`` of a task reach, three per task."""

    task: str
    scenes: int
    share: float


@dataclass(frozen=True)
class Passed:
    """RQ1: scenes that each of seven policies passed in a task, counted in the authors' data."""

    task: str
    policy: str
    passed: int
    of: int


@dataclass(frozen=True)
class Success:
    """RQ1: a share as printed, and as printed elsewhere, of one policy or the ``mean`` or ``best`` of all."""

    task: str
    policy: str
    share: float
    as_well: float | None


@dataclass(frozen=True, kw_only=True)
class Mutated:
    """RQ3 (light) and RQ4 (camera): passes of RQ1, and how many of them are left.

    Attributes:
        task, policy: ``all`` for totals.
        mutated: how many of these it still passes, the mean of three mutations each.
        kept: ``mutated / default``.
        right_default, right_mutated, right_kept: the correct value of a sum or ratio that is misprinted.
    """

    study: str
    task: str
    policy: str
    default: int | None
    mutated: float | None
    kept: float | None
    right_default: int | None
    right_mutated: float | None
    right_kept: float | None


_Row = TypeVar("_Row")


def rows(kind: type[_Row]) -> tuple[_Row, ...]:
    """The known rows of a kind, from the file that is named after it; an empty field is None.

    Raises:
        CatalogueError: the file is missing or has other fields.
    """
    path = published_dir() / f"{kind.__name__.lower()}.csv"
    try:
        lines = [line for line in path.read_text(encoding="utf-8").splitlines() if not line.startswith("#")]
        known = [{key: value or None for key, value in row.items()} for row in csv.DictReader(lines)]
        return tuple(TypeAdapter(list[kind]).validate_python(known))  # type: ignore[valid-type]
    except (OSError, ValidationError) as error:
        raise CatalogueError(f"{path}: {' '.join(str(error).split())}") from None
