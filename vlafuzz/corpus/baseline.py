"""How a run did beside random generation: two shares of failing scenes, and whether they differ."""

from __future__ import annotations

import math
from dataclasses import dataclass

from vlafuzz.corpus.store import Corpus
from vlafuzz.scoring import Interval, wilson


@dataclass(frozen=True)
class Beside:
    """A run beside the random runs of its store that were made under the same conditions, taken together.

    Attributes:
        judged: distinct scenes that passed or failed; ``random_judged`` is 0 without a random run.
        difference: of the two shares, the run's minus random's; None when one has no scenes.
        low: lower end of its 95 % interval, ``high`` the upper one. It takes the scenes of a run as
            independent; those of a guided strategy resemble each other, so it is somewhat too narrow.
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
        """Whether the scenes suffice to say which share is larger."""
        return self.low is not None and self.high is not None and not self.low <= 0 <= self.high


def beside_random(corpus: Corpus, run: int) -> Beside:
    """A run beside the random runs that differ from it in strategy, budget, batch and seed only."""
    runs = {each.id: each.manifest for each in corpus.runs()}
    conditions = runs[run].conditions
    random = [
        number
        for number, manifest in runs.items()
        if manifest.strategy == "random" and manifest.conditions == conditions
    ]
    counts = *corpus.judged([run]), *corpus.judged(random)
    if not (counts[1] and counts[3]):
        return Beside(*counts, None, None, None)
    return Beside(*counts, counts[0] / counts[1] - counts[2] / counts[3], *newcombe(*counts))


def newcombe(k: int, n: int, other_k: int, other_n: int) -> Interval:
    """95 % interval of ``k / n - other_k / other_n``, from the two shares' own intervals.

    Newcombe 1998, method 10 <https://doi.org/10.1002/(SICI)1097-0258(19980430)17:8%3C873::AID-SIM779%3E3.0.CO;2-I>:
    SciPy has Wilson's interval, not this one.
    """
    share, other = k / n, other_k / other_n
    mine, others = wilson(k, n), wilson(other_k, other_n)
    return Interval(
        share - other - math.hypot(share - mine.low, others.high - other),
        share - other + math.hypot(mine.high - share, other - others.low),
    )
