"""What the surrogate does with what it is told."""

from collections.abc import Callable

import numpy as np

from tests.search.worlds import space
from vlafuzz.model import Verdict
from vlafuzz.search.base import Proposal
from vlafuzz.search.proposals import Random
from vlafuzz.search.scoring import Score
from vlafuzz.search.surrogate import KEPT, WARM, Surrogate

PASSED = Score(Verdict.PASSED, 1.0, 1.0, slack=0.5)
FAILED = Score(Verdict.FAILED, 0.3, 1.0, cell="grasp|base|x0y0")


def dark(proposal: Proposal) -> Score:
    """The policy fails where there is very little light."""
    return FAILED if space().decode(proposal.genome).light.intensity < 0.2 else PASSED


def later_in_the_dark(proposal: Proposal) -> Score:
    """The policy passes everywhere, and needs longer the darker it is."""
    return Score(Verdict.PASSED, 1.0, 1.0, slack=min(space().decode(proposal.genome).light.intensity / 20, 1.0))


def played(judge: Callable[[Proposal], Score], batches: int) -> tuple[Surrogate, list[Proposal]]:
    strategy, proposals = Surrogate(space(), 0, 200), list[Proposal]()
    for _ in range(batches):
        asked = strategy.ask(16)
        strategy.tell(asked, [judge(proposal) for proposal in asked])
        proposals += asked
    return strategy, proposals


def lights(proposals: list[Proposal]) -> list[float]:
    return [space().decode(proposal.genome).light.intensity for proposal in proposals]


def test_the_first_scenes_are_random_and_most_fail_once_it_is_known_where_and_what_it_keeps_is_bounded():
    strategy, proposals = played(dark, 6)
    drawn = Random(space(), 0).ask(WARM)
    assert [p.genome.tolist() for p in proposals[:WARM]] == [p.genome.tolist() for p in drawn]
    shares = [np.mean([dark(proposal).failed for proposal in part]) for part in (proposals[:WARM], proposals[48:])]
    assert shares[0] < 0.5 < 0.6 < shares[1] < 1.0
    assert len(strategy._stock) <= KEPT
    assert not strategy._pending


def test_before_the_first_failure_it_goes_where_the_policy_passes_late():
    _, proposals = played(later_in_the_dark, 6)
    assert np.median(lights(proposals[WARM:])) < 0.6 * np.median(lights(proposals[:WARM]))


def test_among_scenes_that_fail_alike_it_proposes_those_unlike_known_failures():
    strategy, _ = played(lambda _: FAILED, 2)
    known = np.array([space().embed(space().decode(genome)) for genome in strategy._failures])

    def distances(proposals: list[Proposal]) -> float:
        points = [space().embed(space().decode(proposal.genome)) for proposal in proposals]
        return float(np.mean([np.sort(np.linalg.norm(known - point, axis=1))[:3].mean() for point in points]))

    assert distances(strategy.ask(16)) > 1.1 * distances(Random(space(), 9).ask(64))
