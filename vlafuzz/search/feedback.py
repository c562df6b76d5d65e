"""Feedback: an AFL-style fuzzer. Scenes that reach a new place are kept as seeds and mutated."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vlafuzz.search.base import Genome, Proposal, Source
from vlafuzz.search.proposals import TRIES, OneByOne
from vlafuzz.search.scoring import Score
from vlafuzz.search.variation import Variation

MOST_SEEDS = 500  # beyond this, the seed of the place reached most often is dropped
BLIND = 0.5  # share of random scenes before the first failure: ease may be misleading
GUIDED = 0.15  # and after it: there may be failures elsewhere
SPLICED = 0.2  # share of children with confounders from another seed
AGAIN = 0.4  # chance that a mutation changes one more operator
BUCKETS = 2  # of times to success, per doubling
FADES = 0.98  # discount of a bandit's past rewards

Rng = np.random.Generator


@dataclass
class Seed:
    """The least severe scene that reached a place, and how often the place was reached."""

    genome: Genome
    score: Score
    hits: int = 1


@dataclass(frozen=True)
class Parentage:
    """Whether the parent of a proposal failed, its ease, and the operators changed in the child."""

    failed: bool
    ease: float
    operators: tuple[str, ...]


class Feedback(OneByOne):
    """Mutates scenes that reached a new place, those in rarely reached places most: AFL-style.

    See Zalewski <https://lcamtuf.coredump.cx/afl/technical_details.txt>. AFL's branches correspond to
    *places*: the cell of a failure, or how late a pass succeeded. A place keeps its least severe scene as a
    seed. Seeds in rarely reached places are chosen more often, as in AFLFast (Böhme, Pham, Roychoudhury 2016,
    <https://doi.org/10.1145/2976749.2978428>). Two bandits learn which operators to mutate: one from passes
    that become harder, one from failures that reach rare places.
    """

    def __init__(self, space: Source, seed: int, budget: int | None = None) -> None:
        super().__init__(space, seed)
        self._variation = Variation(space.genes)
        self._seeds: dict[str, Seed] = {}
        self._parents: dict[int, Parentage] = {}
        self._bandits = {failed: Bandit() for failed in (False, True)}

    def tell(self, proposals: Sequence[Proposal], scores: Sequence[Score]) -> None:
        """Update the seeds, and learn which mutations paid off."""
        for proposal, score in zip(proposals, scores, strict=True):
            hits = self._keep(proposal.genome, score) if score.rolled_out else 0
            parent = self._parents.pop(proposal.id, None)
            if parent is not None:
                harder = float(score.ease < parent.ease)
                pay = (score.failed / hits if hits else 0.0) if parent.failed else harder
                self._bandits[parent.failed].learn(parent.operators, pay)

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
        if not self._is_fresh(rng):
            for _ in range(TRIES):
                genome, parentage = self._child(rng)
                if self._proposals.new([genome])[0]:
                    self._parents[number] = parentage
                    return self._proposals.registered(genome)
        return self._proposals.fresh(rng)

    def _is_fresh(self, rng: Rng) -> bool:
        """Whether to draw a random scene: always, while there are fewer than two seeds."""
        share = GUIDED if any(seed.score.failed for seed in self._seeds.values()) else BLIND
        return len(self._seeds) < 2 or rng.random() < share

    def _child(self, rng: Rng) -> tuple[Genome, Parentage]:
        seeds = list(self._seeds.values())
        energy = np.array([1 / seed.hits for seed in seeds])
        parent, donor = (seeds[index] for index in rng.choice(len(seeds), size=2, p=energy / energy.sum()))
        genome = parent.genome
        if rng.random() < SPLICED:
            genome = self._variation.splice(genome, donor.genome, rng)
        operators = self._bandits[parent.score.failed].choose(self._variation.operators(genome), rng)
        child = self._proposals.fair(self._variation.mutate(genome, operators, rng), rng)
        return child, Parentage(parent.score.failed, parent.score.ease, operators)


class Bandit:
    """Thompson sampling over operators, with a Beta posterior of how often mutating each one paid off."""

    def __init__(self) -> None:
        self._paid: dict[str, float] = {}
        self._tried: dict[str, float] = {}

    def choose(self, operators: Sequence[str], rng: Rng) -> tuple[str, ...]:
        """The operators with the highest sampled payoff: one, sometimes several."""
        count = min(int(rng.geometric(1 - AGAIN)), len(operators))
        paid = np.array([self._paid.get(name, 0.0) for name in operators])
        tried = np.array([self._tried.get(name, 0.0) for name in operators])
        beliefs = rng.beta(1 + paid, 1 + tried - paid)
        return tuple(operators[index] for index in np.argsort(-beliefs)[:count])

    def learn(self, operators: Sequence[str], pay: float) -> None:
        """Update the belief in these operators by a reward in [0, 1]."""
        for name in operators:
            self._paid[name] = FADES * self._paid.get(name, 0.0) + pay
            self._tried[name] = FADES * self._tried.get(name, 0.0) + 1


def _place(score: Score) -> str:
    """The place a scene reached: a failure's cell, or how late a pass succeeded, in logarithmic steps."""
    if score.failed:
        return score.cell or "failed"
    return f"passed {round(-BUCKETS * math.log2(max(score.slack, 1e-6)))}"
