"""A search without a store: a strategy's scenes, each rolled out once, in the order of a campaign."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator

from vlafuzz.model import Outcome, Scene
from vlafuzz.search.base import Proposal, Strategy, batch_of, overlaps
from vlafuzz.search.scoring import Score, score
from vlafuzz.worlds.tabletop.space import SearchSpace

MOST_IDLE = 800  # proposals without a rollout after which a strategy has nothing left to propose
Tried = tuple[Scene, Score]  # a scene that took a rollout


def search(
    space: SearchSpace,
    evaluate: Callable[[Scene], Outcome],
    strategy: Strategy,
    budget: int,
    known: dict[str, Score] | None = None,
) -> Iterator[list[Tried]]:
    """The new scenes of every proposal or batch that is told; known and invalid scenes cost nothing."""
    known = {} if known is None else known
    awaited: deque[Proposal] = deque()
    spent = idle = 0
    while idle < MOST_IDLE:
        awaited += _asked(strategy, min(batch_of(strategy), budget - spent) - len(awaited))
        if not awaited:
            return
        proposals = [awaited.popleft() for _ in range(1 if overlaps(strategy) else len(awaited))]
        scores, tried = [], []
        for scene in (space.decode(proposal.genome) for proposal in proposals):
            if scene.digest not in known:
                known[scene.digest] = score(scene, evaluate(scene), space)
                if known[scene.digest].rolled_out:
                    tried.append((scene, known[scene.digest]))
            scores.append(known[scene.digest])
        strategy.tell(proposals, scores)
        spent += len(tried)
        idle = 0 if tried else idle + len(proposals)
        yield tried


def _asked(strategy: Strategy, room: int) -> list[Proposal]:
    """Up to ``room`` proposals, in the portions in which a campaign asks for them."""
    if not overlaps(strategy):
        return strategy.ask(room) if room > 0 else []
    proposals: list[Proposal] = []
    while len(proposals) < room and (more := strategy.ask(1)):
        proposals += more
    return proposals
