"""What baselines from the literature do with their scores."""

import numpy as np
import pytest

from tests.search.test_nsga2 import EARLY, HARD, LATE, SIMPLE, dominates, population
from tests.search.test_surrogate import FAILED, PASSED, dark
from tests.search.worlds import space
from vlafuzz.model.outcome import Verdict
from vlafuzz.search.base import Genome, Proposal
from vlafuzz.search.baselines.art_rf import ArtRf
from vlafuzz.search.baselines.map_elites import GUIDED, MapElites
from vlafuzz.search.baselines.mcts import Mcts, _perturbed
from vlafuzz.search.nsga2 import Nsga2D
from vlafuzz.search.proposals import Random
from vlafuzz.search.scoring import Score


def failing(progress: float, cell: str = "grasp|light|x0y0") -> Score:
    return Score(Verdict.FAILED, progress, 1.0, cell=cell)


def nearest(genomes: list[Genome]) -> float:
    """Mean distance of each scene to the one that is nearest."""
    points = np.array([space().embed(space().decode(genome)) for genome in genomes])
    distances = np.linalg.norm(points[:, None] - points, axis=2) + np.diag(np.full(len(points), np.inf))
    return float(distances.min(axis=1).mean())


def test_scenes_of_art_lie_farther_apart_than_random_ones():
    adaptive, drawn = (strategy.ask(60) for strategy in (ArtRf(space(), 0), Random(space(), 0)))
    assert nearest([p.genome for p in adaptive]) > 1.05 * nearest([p.genome for p in drawn])


def test_what_the_forest_of_art_has_seen_fail_is_tried_more():
    strategy, failed = ArtRf(space(), 0), []
    for _ in range(10):
        asked = strategy.ask(16)
        scores = [dark(proposal) for proposal in asked]
        failed.append(sum(score.failed for score in scores))
        strategy.tell(asked, scores)
    assert sum(failed[5:]) > 0.7 * 80


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


NARROW = space("pick-up", "light", "camera-orientation")


def test_branches_of_mcts_that_fail_are_tried_more():
    strategy = Mcts(NARROW, 0)
    for _ in range(12):
        asked = strategy.ask(16)
        far = [NARROW.severities(NARROW.decode(proposal.genome))["light"] > 0.5 for proposal in asked]
        strategy.tell(asked, [FAILED if fails else PASSED for fails in far])
    assert sum(far) > 0.6 * 16


@pytest.mark.parametrize(("extent", "low", "high"), [("nominal", 0, 0), ("near", 0, 0.5), ("far", 0.5, 1)])
def test_an_extent_says_how_far_a_gene_is_from_nominal(extent: str, low: float, high: float):
    (gene,) = [gene for gene in space().genes if gene.path == "light.intensity"]
    for where in np.random.default_rng(0).random(50):
        level = int(_perturbed(gene, where, extent) * gene.grid.size)
        assert low - 0.02 <= gene.distance(gene.grid.value(level)) <= high + 0.02


def test_what_was_not_judged_leaves_no_trace_in_the_tree():
    strategy = Mcts(space(), 0)
    strategy.tell(strategy.ask(6), [Score(Verdict.INVALID, None, 0.0)] * 6)
    assert (strategy._root.visits, strategy._root.failures) == (0, 0)


@pytest.mark.parametrize("score", [EARLY, LATE, HARD, SIMPLE])
def test_distance_from_known_failures_is_a_merit_of_every_scene(score: Score):
    assert dominates(Nsga2D._objectives(score, 1.0), Nsga2D._objectives(score, 0.5))


@pytest.mark.parametrize(("last", "left"), [("a", 10), ("b", 20)])
def test_when_no_new_cell_is_reached_for_a_generation_half_the_population_leaves(last: str, left: int):
    strategy = Nsga2D(space(), 0, 300)  # a population of 20
    for scores in ([failing(0.3, "a")] * 20, [failing(0.3, "a")] * 19, [failing(0.3, last)]):
        strategy.tell(strategy.ask(len(scores)), scores)
    assert len(population(strategy)) == left
