"""A strategy as a user writes one: the example of docs/strategies.md."""

import numpy as np

from vlafuzz.search.base import Proposal


class Climb:
    """Moves the scene that was hardest so far a little, again and again."""

    def __init__(self, space, seed, budget):
        self.space, self.rng = space, np.random.default_rng(seed)
        self.asked, self.best, self.ease = 0, None, 1.5  # 2 is a pass at once, below 1 is a failure

    def ask(self, n):
        first, self.asked = self.asked, self.asked + n
        return [Proposal(number, self.space.encode(self.scene())) for number in range(first, self.asked)]

    def scene(self):  # random until one is hard, then near the hardest; repaired where objects collide
        if self.best is None:
            return self.space.sample(self.rng)
        moved = self.best + self.rng.normal(0, 0.05, self.space.dim)
        return self.space.repaired(self.space.decode(moved.clip(0, 1)), self.rng) or self.scene()

    def tell(self, proposals, scores):
        for proposal, score in zip(proposals, scores, strict=True):
            if score.ease < self.ease:
                self.best, self.ease = proposal.genome, score.ease


make = Climb
