"""Numbers of a finished run: distinct failures, and the share of failures beside random generation."""

import json
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vlafuzz.common.statistics import newcombe
from vlafuzz.common.text import plural
from vlafuzz.model.scene import Scene
from vlafuzz.model.scene_lines import load_verdicts
from vlafuzz.store.store import Store

# Two scenes that differ in one operator only are at most 1 apart. Nudging every gene by 2 % of its range
# moves a scene by less than 0.1, another object in one slot by 0.5 or more; and of 180,000 pairs of random
# scenes none was nearer than 0.3.
RADIUS = 0.2

Embed = Callable[[Scene], NDArray[np.float64]]
"""A scene as a vector in which distance means difference."""


def clusters(scenes: Iterable[Scene], embed: Embed) -> int:
    """The number of groups of near-duplicates among scenes."""
    return len(set(neighbourhoods(scenes, embed).values()))


def neighbourhoods(scenes: Iterable[Scene], embed: Embed) -> dict[Scene, int]:
    """The number of each scene's group of near-duplicates.

    As in BIRCH (Zhang et al. 1996), a scene joins the group with the nearest centre if the root mean square distance
    from it stays within ``RADIUS``, else it begins one. A chain of small steps is not one group.
    """
    # Sorted, so that the order of scenes does not matter.
    ordered = sorted(set(scenes), key=lambda scene: scene.digest)
    if len(ordered) < 2:
        return dict.fromkeys(ordered, 0)
    points = np.stack([embed(scene) for scene in ordered])
    centres, sizes, squares = np.empty_like(points), np.zeros(len(points)), np.zeros(len(points))
    groups: dict[Scene, int] = {}
    count = 0
    for scene, point in zip(ordered, points, strict=True):
        groups[scene] = count
        if count:
            near = int(((centres[:count] - point) ** 2).sum(axis=1).argmin())
            size, square = sizes[near] + 1, squares[near] + point @ point
            centre = centres[near] + (point - centres[near]) / size
            if square / size - centre @ centre <= RADIUS**2:
                centres[near], sizes[near], squares[near] = centre, size, square
                groups[scene] = near
                continue
        centres[count], sizes[count], squares[count] = point, 1, point @ point
        count += 1
    return groups


@dataclass(frozen=True, kw_only=True)
class Beside:
    """A run beside all random runs of its store under the same conditions, pooled.

    Attributes:
        judged: distinct scenes that passed or failed; ``random_judged`` is 0 without a random run. difference: the
        run's share of failures minus random's; None when either has no scenes.
        low: lower end of its 95 % interval, ``high`` the upper one. The interval takes scenes as independent, so it is
            somewhat too narrow for a guided strategy, whose scenes resemble each other.
    """

    failed: int
    judged: int
    random_failed: int
    random_judged: int
    difference: float | None = None
    low: float | None = None
    high: float | None = None

    @property
    def tells(self) -> bool:
        """Whether the interval excludes 0."""
        return self.low is not None and self.high is not None and not self.low <= 0 <= self.high


def beside_random(store: Store, run: int) -> Beside:
    """A run beside the random runs that differ from it in strategy, budget, batch and seed only."""
    runs = {stored.id: stored.manifest for stored in store.runs()}
    random = [
        number for number, manifest in runs.items() if manifest.strategy == "random" and manifest.comparable(runs[run])
    ]
    (failed, judged), (random_failed, random_judged) = store.judged([run]), store.judged(random)
    beside = Beside(failed=failed, judged=judged, random_failed=random_failed, random_judged=random_judged)
    if not (judged and random_judged):
        return beside
    low, high = newcombe(failed, judged, random_failed, random_judged)
    return replace(beside, difference=failed / judged - random_failed / random_judged, low=low, high=high)


@dataclass(frozen=True, kw_only=True)
class Again:
    """What became of the scenes of a file that tells how they ended before.

    Attributes:
        failed: scenes that failed before; ``fixed``: of these, those that pass now.
        passed: scenes that passed before; ``broken``: of these, those that fail now.
        not_begun: scenes of both that the run did not come to.
        invalid: those that are no longer fair; ``errors``: those in which policy or simulator broke.
    """

    failed: int
    fixed: int
    passed: int
    broken: int
    not_begun: int
    invalid: int
    errors: int

    def __str__(self) -> str:
        parts = {
            f"{self.fixed} of {plural(self.failed, 'scene')} that failed before pass now": self.failed,
            f"{self.broken} of {plural(self.passed, 'scene')} that passed before fail now": self.passed,
            f"{self.not_begun} not begun": self.not_begun,
            f"{self.invalid} no longer fair": self.invalid,
            f"{self.errors} ended in an error": self.errors,
        }
        return ", ".join(words for words, count in parts.items() if count)


def again(store: Store, run: int) -> Again | None:
    """A run of the scenes of a file beside what the file tells; None where it tells nothing, or is gone."""
    manifest = next(stored.manifest for stored in store.runs() if stored.id == run)
    source = json.loads(manifest.scene_file or "{}")
    if source.get("flag") != "scenes" or not Path(source["file"]).is_file():
        return None
    before = load_verdicts(Path(source["file"]))
    now = {trial.scene.digest: trial.outcome.verdict.name.lower() for trial in store.trials(run)}
    pairs = Counter((verdict, now.get(digest)) for digest, verdict in before.items())
    ended = Counter(now.get(digest) for digest in before)
    if not pairs:
        return None
    count = Counter(before.values())
    return Again(
        failed=count["failed"],
        fixed=pairs["failed", "passed"],
        passed=count["passed"],
        broken=pairs["passed", "failed"],
        not_begun=ended[None],
        invalid=ended["invalid"],
        errors=ended["error"],
    )
