"""Clusters: the number of different failures, near-duplicates counted as one."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
from numpy.typing import NDArray

from vlafuzz.scene import Scene

# Two scenes that differ in one operator only are at most 1 apart. Nudging every gene by 2 % of its range
# moves a scene by less than 0.1, another object in one slot by 0.5 or more; and of 180,000 pairs of random
# scenes none was nearer than 0.3.
RADIUS = 0.2

Embed = Callable[[Scene], NDArray[np.float64]]
"""A scene as a vector in which distance means difference."""


def clusters(scenes: Iterable[Scene], embed: Embed) -> int:
    """The number of groups of near-duplicates among scenes.

    Birch puts each scene into the nearest group whose radius stays below ``RADIUS``, or begins a new one.
    A chain of small steps does not become one group, as with DBSCAN, and each scene is looked at once (10,000
    take seconds), while complete linkage, which would be exact, needs all pairs in memory.
    """
    ordered = sorted(
        set(scenes), key=lambda scene: scene.digest
    )  # so that the order of scenes does not matter
    if len(ordered) < 2:
        return len(ordered)
    from sklearn.cluster import Birch  # takes a second to import

    tree = Birch(threshold=RADIUS, n_clusters=None).fit(np.stack([embed(scene) for scene in ordered]))
    return len(tree.subcluster_centers_)
