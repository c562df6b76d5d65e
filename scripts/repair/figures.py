"""Figures of a repair: how often the policies of every arm fail, before and after, with intervals.

All policies are judged in the same scenes, so that differences are paired. Intervals are percentiles of a bootstrap
over the scenes of each task and over the repetitions of an arm.
"""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

SHIPPED, RANDOM = "shipped", "random"
DRAWS = 4000
Array = NDArray[np.float64]
Estimate = tuple[float, float, float]  # value, and the 95 % interval


@dataclass(frozen=True, eq=False)
class Judged:
    """``failed`` (repetitions, scenes) of one arm, by kind of scene and task; 0 or 1."""

    arm: str
    failed: dict[tuple[str, str], Array]


Scenes = dict[tuple[str, str], dict[int, bool]]  # whether a policy failed, by kind and task, and scene


def scenes_of(folder: Path) -> Scenes:
    """What ``judged`` wrote of one policy."""
    scenes: Scenes = defaultdict(dict)
    for path in folder.glob("*.jsonl"):
        for row in map(json.loads, path.read_text().splitlines()):
            scenes[row["kind"], row["task"]][row["scene"]] = row["failed"]
    return scenes


def read(folder: Path) -> dict[str, Judged]:
    """What ``judged`` wrote, by arm."""
    found: dict[str, list[Scenes]] = defaultdict(list)
    for policy in sorted((folder / "judged").iterdir()):
        arm = policy.name if policy.name == SHIPPED else policy.name.rpartition("-")[0]
        found[arm].append(scenes_of(policy))
    return {arm: Judged(arm, _matrices(found[SHIPPED][0], several)) for arm, several in found.items()}


def _matrices(shipped: Scenes, several: Sequence[Scenes]) -> dict[tuple[str, str], Array]:
    return {
        key: np.array([[one[key][scene] for scene in sorted(scenes)] for one in several], dtype=float)
        for key, scenes in shipped.items()
    }


def share(one: Judged, kind: str, tasks: Sequence[str]) -> Estimate:
    """Share of failures in scenes of a kind, the mean over tasks."""
    return _estimate([one.failed[kind, task] for task in tasks])


def difference(one: Judged, other: Judged, kind: str, tasks: Sequence[str]) -> Estimate:
    """By how much one arm fails more often than another one, in the same scenes and repetitions."""
    return _estimate([one.failed[kind, task] - other.failed[kind, task] for task in tasks])


def _estimate(several: Sequence[Array]) -> Estimate:
    rng = np.random.default_rng(0)
    repeats = len(several[0])
    drawn = np.empty(DRAWS)
    for number in range(DRAWS):
        rows = rng.integers(repeats, size=repeats)
        means = [table[rows].mean(0)[rng.integers(table.shape[1], size=table.shape[1])].mean() for table in several]
        drawn[number] = np.mean(means)
    low, high = np.quantile(drawn, (0.025, 0.975))
    return float(np.mean([table.mean() for table in several])), float(low), float(high)


@dataclass(frozen=True)
class Row:
    """One arm; all figures are shares with their 95 % intervals.

    Attributes:
        failures: in random scenes, by task, and ``all``.
        fewer: failures in random scenes than the shipped policy has; and than the arm ``random`` has. nominal: failures
        in nominal scenes of all tasks; ``lost``: how many more than the shipped policy.
    """

    arm: str
    repeats: int
    failures: dict[str, Estimate]
    fewer: Estimate
    fewer_than_random: Estimate | None
    nominal: Estimate
    lost: Estimate


def rows(folder: Path, tasks: Sequence[str]) -> list[Row]:
    """One row per arm."""
    arms = read(folder)
    all_tasks = sorted({task for kind, task in arms[SHIPPED].failed if kind == "nominal"})

    def row(one: Judged) -> Row:
        against = arms.get(RANDOM)
        return Row(
            one.arm,
            len(next(iter(one.failed.values()))),
            {task: share(one, "random", [task]) for task in tasks} | {"all": share(one, "random", tasks)},
            difference(arms[SHIPPED], one, "random", tasks),
            difference(against, one, "random", tasks) if against and one.arm != SHIPPED else None,
            share(one, "nominal", all_tasks),
            difference(one, arms[SHIPPED], "nominal", all_tasks),
        )

    order = sorted(arms, key=lambda name: (name != SHIPPED, "again" in name, name))
    return [row(arms[name]) for name in order]
