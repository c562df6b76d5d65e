from collections.abc import Callable

import numpy as np

from tests.search.worlds import EASY, judged, space, toy
from vlafuzz.model.outcome import Verdict
from vlafuzz.search import surrogate
from vlafuzz.search.base import Proposal
from vlafuzz.search.proposals import Random
from vlafuzz.search.scoring import Score
from vlafuzz.search.surrogate import WARM, Surrogate

PASSED = Score(Verdict.PASSED, 1.0, 1.0, slack=0.5)
FAILED = Score(Verdict.FAILED, 0.3, 1.0, cell="grasp|base|x0y0")


def dark(proposal: Proposal) -> Score:
    """The policy fails in the dark."""
    return FAILED if space().decode(proposal.genome).light.intensity < 1 else PASSED


def played(strategy: Surrogate, judge: Callable[[Proposal], Score], batches: int = 6) -> list[Proposal]:
    proposals = []
    for _ in range(batches):
        asked = strategy.ask(16)
        strategy.tell(asked, [judge(proposal) for proposal in asked])
        proposals += asked
    return proposals


def sites(proposals: list[Proposal]) -> list[str]:
    scenes = [space().decode(proposal.genome) for proposal in proposals]
    return [space().site(scene, space().severities(scene)) for scene in scenes]


def failing(proposals: list[Proposal]) -> list[Proposal]:
    return [proposal for proposal in proposals if dark(proposal).failed]


def test_once_the_forest_knows_where_failures_are_most_scenes_fail():
    assert len(failing(played(Surrogate(space(), 0, 200), dark, 10)[96:])) > 50


def test_failures_are_looked_for_at_new_sites():
    found = sites(failing(played(Surrogate(space(), 0, 200), dark, 10)))
    assert len(set(found)) > 0.95 * len(found)


def test_as_long_as_nothing_is_foreseen_it_is_random():
    asked = played(Surrogate(space(), 3, 200), lambda _: PASSED)
    drawn = Random(space(), 3).ask(len(asked))
    assert [p.genome.tolist() for p in asked[WARM:]] == [p.genome.tolist() for p in drawn[WARM:]]


def test_the_first_scenes_are_farther_from_nominal_than_random_ones():
    def far(proposals: list[Proposal]) -> float:
        scenes = [space().decode(proposal.genome) for proposal in proposals]
        return float(np.mean([space().severity(scene) for scene in scenes]))

    assert far(Surrogate(space(), 3, 200).ask(WARM)) > 1.2 * far(Random(space(), 3).ask(WARM))


def test_lateness_leads_to_a_first_failure_where_it_can_be_foreseen():
    evaluator, strategy = toy(EASY, 0.002), Surrogate(space(), 0, 300)
    slacks = []
    for _ in range(12):
        asked = strategy.ask(16)
        scores = judged(evaluator, [space().decode(proposal.genome) for proposal in asked], space())
        slacks.append(np.mean([score.slack for score in scores]))
        strategy.tell(asked, scores)
    assert np.mean(slacks[-3:]) < 0.9 * np.mean(slacks[:2])


def test_what_it_keeps_is_bounded(monkeypatch):
    monkeypatch.setattr(surrogate, "KEPT", 32)
    strategy = Surrogate(space(), 0, 1000)
    played(strategy, dark, batches=4)
    assert len(strategy._stock) == 32
    assert not strategy._out
