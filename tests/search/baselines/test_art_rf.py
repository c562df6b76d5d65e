import numpy as np

from tests.search.test_surrogate import dark
from tests.search.worlds import space
from vlafuzz.model.outcome import Verdict
from vlafuzz.search.base import Genome
from vlafuzz.search.baselines.art_rf import ArtRf
from vlafuzz.search.proposals import Random
from vlafuzz.search.scoring import Score

PASSED = Score(Verdict.PASSED, 1.0, 1.0, slack=0.5)


def nearest(genomes: list[Genome]) -> float:
    """Mean distance of each scene to the one that is nearest."""
    points = np.array([space().embed(space().decode(genome)) for genome in genomes])
    distances = np.linalg.norm(points[:, None] - points, axis=2) + np.diag(np.full(len(points), np.inf))
    return float(distances.min(axis=1).mean())


def test_scenes_lie_farther_apart_than_random_ones():
    adaptive, drawn = (strategy.ask(60) for strategy in (ArtRf(space(), 0), Random(space(), 0)))
    assert nearest([p.genome for p in adaptive]) > 1.05 * nearest([p.genome for p in drawn])


def test_what_the_forest_has_seen_fail_is_tried_more():
    strategy, failed = ArtRf(space(), 0), []
    for _ in range(10):
        asked = strategy.ask(16)
        scores = [dark(proposal) for proposal in asked]
        failed.append(sum(score.failed for score in scores))
        strategy.tell(asked, scores)
    assert sum(failed[5:]) > 0.7 * 80


def test_without_a_failure_there_is_no_forest():
    strategy = ArtRf(space(), 0)
    strategy.tell(strategy.ask(40), [PASSED] * 40)
    assert strategy._forest is None
