"""What MAP-Elites does with its scores."""

from tests.search.worlds import space
from vlafuzz.model.outcome import Verdict
from vlafuzz.search.base import Proposal
from vlafuzz.search.map_elites import GUIDED, MapElites
from vlafuzz.search.scoring import Score


def failing(progress: float, cell: str = "grasp|light|x0y0") -> Score:
    return Score(Verdict.FAILED, progress, 1.0, cell=cell)


def elites(*scores: Score) -> tuple[MapElites, list[float]]:
    """A strategy told these of the same scene, so of one place and operator; the eases that it keeps."""
    strategy = MapElites(space(), 0, 100)
    (first,) = strategy.ask(1)
    strategy.tell([Proposal(number, first.genome) for number in range(len(scores))], scores)
    return strategy, sorted(ease for ease, _ in strategy._archive.values())


def test_a_niche_keeps_the_scene_that_fails_earliest_and_another_lost_stage_is_another_one():
    lifted, passed = failing(0.7, "lift|light|x0y0"), Score(Verdict.PASSED, 1.0, 1.0, slack=0.1)
    assert elites(failing(0.6), failing(0.1), failing(0.6))[1] == [0.1]
    strategy, kept = elites(failing(0.6), lifted, passed, Score(Verdict.INVALID, None, 0.0))
    assert kept == [0.6, 0.7, 1.1]
    parents, share = strategy._parents()  # only failures have children
    assert (len(parents), share) == (2, GUIDED)


def test_another_place_or_farthest_operator_is_another_niche():
    strategy = MapElites(space(), 0, 100)
    strategy.tell(strategy.ask(60), [failing(0.1)] * 60)
    assert 15 < len(strategy._archive) < 60
