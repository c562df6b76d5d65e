"""A search without a store: a strategy's scenes, each rolled out once."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from vlafuzz.outcome import Outcome
from vlafuzz.scene import Scene
from vlafuzz.scoring import Score, score
from vlafuzz.search.base import Strategy
from vlafuzz.space import SearchSpace

BATCH = 16
MOST_IDLE = 50  # batches without a rollout after which a strategy has nothing left to propose
Tried = tuple[Scene, Score]  # a scene that took a rollout


def search(
    space: SearchSpace, evaluate: Callable[[Scene], Outcome], strategy: Strategy, budget: int
) -> Iterator[list[Tried]]:
    """The new scenes of every batch; known and invalid scenes cost nothing."""
    known: dict[str, Score] = {}
    spent = idle = 0
    while spent < budget and idle < MOST_IDLE:
        proposals = strategy.ask(min(BATCH, budget - spent))
        scores, tried = [], []
        for scene in (space.decode(proposal.genome) for proposal in proposals):
            if scene.digest not in known:
                known[scene.digest] = score(scene, evaluate(scene), space)
                if known[scene.digest].rolled_out:
                    tried.append((scene, known[scene.digest]))
            scores.append(known[scene.digest])
        strategy.tell(proposals, scores)
        spent += len(tried)
        idle = 0 if tried else idle + 1
        yield tried
