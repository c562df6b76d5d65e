"""Surrogate: a forest predicts which scenes fail; likely failures in new cells are rolled out."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vlafuzz.search.base import Genome, Proposal, Source
from vlafuzz.search.forest import VOTES, Forest, Numbers
from vlafuzz.search.proposals import ProposalFactory
from vlafuzz.search.scoring import Score
from vlafuzz.search.variation import Variation

SUPPLY = 6  # candidates made for each proposal
KEPT = 256  # best candidates that are kept for the next batch
WARM = 16  # random scenes to begin with, each the most severe of SUPPLY draws
BLIND = 0.5  # share of random scenes before the first failure, if lateness is predictable; else 1
GUIDED = 0.2  # and after it, times the share of proposals that pass: there may be failures elsewhere
REPEATED = 0.2  # worth of another failure at a known site: the lost stage may differ
FRESH = 0.3  # share of the candidates drawn at random
CROSSED = 0.5  # share of the others with a random scene as second parent
AGAIN = 0.5  # chance that a mutation changes one more operator
PARENTS = 200  # the newest failures, and as many of the random scenes
HARDEST = 16  # passes that serve as parents before the first failure

Rng = np.random.Generator


@dataclass(frozen=True, eq=False)
class Candidate:
    """A scene as numbers: the forest's input ``features``, its site, and its severity."""

    genome: Genome
    features: Numbers
    site: str
    severity: float


class Surrogate:
    """Spends the budget on distinct cells, with a forest in the place of most rollouts.

    Fair candidates are generated in advance, at random and from failures. Their *site*, the cell without the lost
    stage, is known before a rollout. The candidate of greatest worth is proposed: the failure probability predicted by
    a random part of the forest, times the novelty of its site. While the forest predicts no better than chance, scenes
    are drawn at random.
    """

    def __init__(self, space: Source, seed: int, budget: int | None = None) -> None:
        self._space, self._seed, self._asked = space, seed, 0
        self._proposals, self._variation = ProposalFactory(space), Variation(space.genes)
        self._forest = Forest(seed)
        self._stock: list[Candidate] = []
        self._out: dict[int, Candidate] = {}
        self._tried: Counter[str] = Counter()  # sites that have failed, or may be about to
        self._failures: deque[Genome] = deque(maxlen=PARENTS)
        self._drawn: deque[Genome] = deque(maxlen=PARENTS)
        self._nearly: list[tuple[float, Genome]] = []  # ease and genome of the hardest passes

    def ask(self, n: int) -> list[Proposal]:
        """Random scenes to begin with, then mostly candidates likely to fail at a new site."""
        first, self._asked = self._asked, self._asked + n
        share = self._share_of_fresh()
        proposals: list[Proposal] = []
        rng = np.random.default_rng([self._seed, first, 1])
        guided = (rng.random(n) >= share) & (np.arange(first, self._asked) >= WARM)
        chosen = iter(self._chosen(int(guided.sum()), rng))
        for number, is_guided in zip(range(first, self._asked), guided, strict=True):
            candidate = next(chosen, None) if is_guided else None
            if candidate is None:
                candidate = self._fresh(number)
                self._tried[candidate.site] += 1
            self._out[number] = candidate
            proposals.append(Proposal(number, candidate.genome))
        return proposals

    def tell(self, proposals: Sequence[Proposal], scores: Sequence[Score]) -> None:
        """Learn from the scenes that were rolled out."""
        judged = []
        for proposal, score in zip(proposals, scores, strict=True):
            candidate = self._out.pop(proposal.id)
            if candidate.genome is not proposal.genome:  # a scene near it was rolled out: see Selection
                self._tried -= Counter([candidate.site])
                candidate = self._candidate(proposal.genome)
                self._tried += Counter([candidate.site])
            if score.failed:
                self._failures.append(candidate.genome)
            else:
                self._tried -= Counter([candidate.site])
            if score.rolled_out:
                judged.append((candidate.features, score))
                if not score.failed:
                    passes = [*self._nearly, (score.ease, candidate.genome)]
                    self._nearly = sorted(passes, key=lambda pair: pair[0])[:HARDEST]
        if judged:
            features, known = zip(*judged, strict=True)
            self._forest.learn(np.array(features), known)

    def _candidate(self, genome: Genome) -> Candidate:
        """Everything known about a genome without a rollout."""
        scene = self._space.decode(genome)
        severities = self._space.severities(scene)
        features = np.concatenate([self._space.embed(scene), genome, list(severities.values())])
        return Candidate(genome, features, self._space.site(scene, severities), sum(severities.values()))

    def _fresh(self, number: int) -> Candidate:
        rng = np.random.default_rng([self._seed, number])
        drawn = [self._proposals.drawn(rng) for _ in range(SUPPLY if number < WARM else 1)]
        candidate = max(map(self._candidate, drawn), key=lambda candidate: candidate.severity)
        self._proposals.registered(candidate.genome)
        return candidate

    def _share_of_fresh(self) -> float:
        if self._failures:
            return 1.0 if self._forest.misleads() else GUIDED * self._forest.misses()
        return BLIND if self._forest.fitted and self._forest.foresees_lateness() else 1.0

    def _chosen(self, n: int, rng: Rng) -> list[Candidate]:
        """Up to ``n`` candidates, each the best given the ones chosen before."""
        genomes = [self._bred(rng) for _ in range(SUPPLY * n)]
        new = self._proposals.new(genomes)
        self._stock += [self._candidate(genome) for genome, is_new in zip(genomes, new, strict=True) if is_new]
        if not (n and self._stock):
            return []
        features = np.array([candidate.features for candidate in self._stock])
        votes = self._forest.votes(features) + 1e-3 if self._forest.fitted else rng.random((1, len(features)))
        left = np.ones(len(self._stock))
        chosen: list[Candidate] = []
        while left.any() and len(chosen) < n:
            ballot = votes[rng.choice(len(votes), min(VOTES, len(votes)), replace=False)].mean(axis=0)
            best = int(np.argmax(np.where(left, ballot * self._worths(), -1.0)))
            left[best] = 0.0
            candidate = self._stock[best]
            if self._proposals.new([candidate.genome])[0]:
                self._proposals.registered(candidate.genome)
                self._tried[candidate.site] += 1
                chosen.append(candidate)
        ranked = np.argsort(-left * votes.mean(axis=0) * self._worths(), kind="stable")[:KEPT]
        self._stock = [self._stock[index] for index in ranked if left[index]]
        return chosen

    def _worths(self) -> Numbers:
        """``(candidates,)`` 1 at a new site, less at one with failures."""
        tried = np.array([self._tried[candidate.site] for candidate in self._stock])
        return np.where(tried > 0, REPEATED ** np.minimum(tried, 5), 1.0)

    def _bred(self, rng: Rng) -> Genome:
        """A random scene, or a child of a failure or a hard pass: a few operators changed, or crossed."""
        fresh = rng.random() < FRESH
        parents = self._failures or [genome for _, genome in self._nearly]
        if fresh or not parents or not self._drawn:
            self._drawn.append(self._space.nearest(self._space.sample(rng)))
            return self._drawn[-1]
        parent = parents[rng.integers(len(parents))]
        if rng.random() < CROSSED:
            other = self._drawn[rng.integers(len(self._drawn))]
            return self._proposals.fair(self._variation.cross(parent, other, rng), rng)
        return self._proposals.fair(self._variation.mutate_some(parent, AGAIN, rng), rng)
