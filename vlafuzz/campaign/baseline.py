"""A run beside random generation: two shares of failing scenes, and whether they differ."""

from __future__ import annotations

from dataclasses import dataclass

from vlafuzz.statistics import newcombe
from vlafuzz.store.store import Store


@dataclass(frozen=True)
class Beside:
    """A run beside all random runs of its store under the same conditions, pooled.

    Attributes:
        judged: distinct scenes that passed or failed; ``random_judged`` is 0 without a random run.
        difference: the run's share of failures minus random's; None when either has no scenes.
        low: lower end of its 95 % interval, ``high`` the upper one. The interval takes scenes as independent,
            so it is somewhat too narrow for a guided strategy, whose scenes resemble each other.
    """

    failed: int
    judged: int
    random_failed: int
    random_judged: int
    difference: float | None
    low: float | None
    high: float | None

    @property
    def tells(self) -> bool:
        """Whether the interval excludes 0."""
        return self.low is not None and self.high is not None and not self.low <= 0 <= self.high


def beside_random(store: Store, run: int) -> Beside:
    """A run beside the random runs that differ from it in strategy, budget, batch and seed only."""
    runs = {stored.id: stored.manifest for stored in store.runs()}
    random = [
        number
        for number, manifest in runs.items()
        if manifest.strategy == "random" and manifest.comparable(runs[run])
    ]
    counts = *store.judged([run]), *store.judged(random)
    if not (counts[1] and counts[3]):
        return Beside(*counts, None, None, None)
    return Beside(*counts, counts[0] / counts[1] - counts[2] / counts[3], *newcombe(*counts))
