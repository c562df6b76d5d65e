from tests.search.worlds import space
from vlafuzz.model.outcome import Verdict
from vlafuzz.search.base import Proposal
from vlafuzz.search.baselines.map_elites import GUIDED, MapElites
from vlafuzz.search.scoring import Score

EARLY = Score(Verdict.FAILED, 0.1, 1.0, cell="grasp|light|x0y0")
LATE = Score(Verdict.FAILED, 0.6, 1.0, cell="grasp|light|x0y0")
LIFTED = Score(Verdict.FAILED, 0.7, 1.0, cell="lift|light|x0y0")
PASSED = Score(Verdict.PASSED, 1.0, 1.0, slack=0.1)


def told(*scores: Score) -> tuple[MapElites, list[Proposal]]:
    """Always of the same scene, so of one place and one farthest operator."""
    strategy = MapElites(space(), 0, 100)
    (first,) = strategy.ask(1)
    proposals = [Proposal(number, first.genome) for number in range(len(scores))]
    strategy.tell(proposals, scores)
    return strategy, proposals


def elites(strategy: MapElites) -> list[float]:
    return sorted(-strategy._archive.data("objective"))


def test_a_niche_keeps_the_scene_that_fails_earliest():
    assert elites(told(LATE, EARLY, LATE)[0]) == [0.1]


def test_another_lost_stage_is_another_niche():
    assert elites(told(LATE, LIFTED, PASSED)[0]) == [0.6, 0.7, 1.1]


def test_another_place_or_farthest_operator_is_another_niche():
    strategy = MapElites(space(), 0, 100)
    asked = strategy.ask(60)
    strategy.tell(asked, [EARLY] * 60)
    scenes = [space().decode(proposal.genome) for proposal in asked]
    assert 15 < strategy._archive.stats.num_elites < 60
    niches = {tuple(strategy._niche(space().encode(scene), EARLY)) for scene in scenes}
    assert len(niches) == strategy._archive.stats.num_elites


def test_once_there_are_failures_only_these_have_children():
    strategy, _ = told(EARLY, LIFTED, PASSED)
    parents, share = strategy._parents()
    assert (len(parents), share) == (2, GUIDED)


def test_what_was_not_judged_has_no_niche():
    assert elites(told(Score(Verdict.INVALID, None, 0.0), Score(Verdict.ERROR, None, 0.0))[0]) == []
