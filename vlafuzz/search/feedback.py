"""Feedback: an AFL-style fuzzer. Scenes that reach a new place are kept as seeds and mutated."""

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vlafuzz.search.base import Genome, Proposal, Source
from vlafuzz.search.proposals import TRIES, OneByOne, Rng
from vlafuzz.search.scoring import Score
from vlafuzz.search.variation import Variation

MOST_SEEDS = 500  # beyond this, the seed of the place reached most often is dropped
BLIND = 0.5  # share of random scenes before the first failure: ease may be misleading
GUIDED = 0.15  # and after it: there may be failures elsewhere
SPLICED = 0.2  # share of children with confounders from another seed
AGAIN = 0.4  # chance that a mutation changes one more operator
BUCKETS = 2  # of times to success, per doubling
FADES = 0.98  # discount of a bandit's past rewards


@dataclass
class Seed:
    """The least severe scene that reached a place, and how often any did."""

    genome: Genome
    score: Score
    hits: int = 1


class Feedback(OneByOne):
    """Mutates scenes that reached a new place, those in rarely reached places most: AFL-style.

    AFL's branches (Zalewski <https://lcamtuf.coredump.cx/afl/technical_details.txt>) are *places*: the cell of a
    failure, or how late a pass succeeded. Seeds in rarely reached places are chosen more often, as in AFLFast (Böhme,
    Pham, Roychoudhury 2016, <https://doi.org/10.1145/2976749.2978428>). Two bandits learn which operators to mutate:
    one from passes that become harder, one from failures that reach rare places.
    """

    def __init__(self, space: Source, seed: int, budget: int | None = None) -> None:
        super().__init__(space, seed)
        self._variation = Variation(space.genes)
        self._seeds: dict[str, Seed] = {}
        self._parents: dict[int, tuple[Score, Sequence[str]]] = {}  # and the operators that were changed
        self._bandits = {failed: Bandit() for failed in (False, True)}

    def tell(self, proposals: Sequence[Proposal], scores: Sequence[Score]) -> None:
        """Update the seeds, and learn which mutations paid off."""
        for proposal, score in zip(proposals, scores, strict=True):
            hits = self._keep(proposal.genome, score) if score.rolled_out else 0
            if proposal.id in self._parents:
                parent, operators = self._parents.pop(proposal.id)
                rare = score.failed / hits if hits else 0.0
                pay = rare if parent.failed else float(score.ease < parent.ease)
                self._bandits[parent.failed].learn(operators, pay)

    def _keep(self, genome: Genome, score: Score) -> int:
        place = _place(score)
        known = self._seeds.get(place)
        if known is None:
            self._seeds[place] = Seed(genome, score)
            if len(self._seeds) > MOST_SEEDS:
                del self._seeds[max(self._seeds, key=lambda place: self._seeds[place].hits)]
            return 1
        known.hits += 1
        if score.severity < known.score.severity:
            known.genome, known.score = genome, score
        return known.hits

    def _genome(self, number: int, rng: Rng) -> Genome:
        share = GUIDED if any(seed.score.failed for seed in self._seeds.values()) else BLIND
        if len(self._seeds) >= 2 and rng.random() >= share:
            for _ in range(TRIES):
                genome, parent, operators = self._child(rng)
                if self._proposals.new([genome])[0]:
                    self._parents[number] = parent, operators
                    return self._proposals.registered(genome)
        return self._proposals.fresh(rng)

    def _child(self, rng: Rng) -> tuple[Genome, Score, Sequence[str]]:
        """A new scene, the score of its parent, and the operators that were changed."""
        seeds = list(self._seeds.values())
        energy = np.array([1 / seed.hits for seed in seeds])
        parent, donor = (seeds[index] for index in rng.choice(len(seeds), size=2, p=energy / energy.sum()))
        genome = parent.genome
        if rng.random() < SPLICED:
            genome = self._variation.splice(genome, donor.genome, rng)
        operators = self._bandits[parent.score.failed].choose(self._variation.operators(genome), rng)
        child = self._proposals.fair(self._variation.mutate(genome, operators, rng), rng)
        return child, parent.score, operators


class Bandit:
    """Thompson sampling over operators, with a Beta posterior of how often mutating each one paid off."""

    def __init__(self) -> None:
        self._paid, self._tried = defaultdict[str, float](float), defaultdict[str, float](float)

    def choose(self, operators: Sequence[str], rng: Rng) -> tuple[str, ...]:
        """The operators with the highest sampled payoff: one, sometimes several."""
        count = min(int(rng.geometric(1 - AGAIN)), len(operators))
        paid, tried = (np.array([known[name] for name in operators]) for known in (self._paid, self._tried))
        beliefs = rng.beta(1 + paid, 1 + tried - paid)
        return tuple(operators[index] for index in np.argsort(-beliefs)[:count])

    def learn(self, operators: Sequence[str], pay: float) -> None:
        """Update the belief in these operators by a reward in [0, 1]."""
        for name in operators:
            self._paid[name] = FADES * self._paid[name] + pay
            self._tried[name] = FADES * self._tried[name] + 1


def _place(score: Score) -> str:
    """The place a scene reached: a failure's cell, or how late a pass succeeded, in logarithmic steps."""
    if score.failed:
        return score.cell or "failed"
    return f"passed {round(-BUCKETS * math.log2(max(score.slack, 1e-6)))}"
