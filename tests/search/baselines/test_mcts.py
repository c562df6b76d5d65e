import numpy as np
import pytest

from tests.search.test_surrogate import FAILED, PASSED
from tests.search.worlds import space
from vlafuzz.model.outcome import Verdict
from vlafuzz.search.base import Proposal
from vlafuzz.search.baselines import mcts
from vlafuzz.search.baselines.mcts import Mcts, _perturbed
from vlafuzz.search.scoring import Score

NARROW = space("pick-up", "light", "camera-orientation")


def far_light(proposal: Proposal) -> Score:
    """The policy fails where the light is far from nominal."""
    scene = NARROW.decode(proposal.genome)
    return FAILED if NARROW.severities(scene)["light"] > 0.5 else PASSED


def played(strategy: Mcts, batches: int) -> list[Score]:
    told = []
    for _ in range(batches):
        asked = strategy.ask(16)
        scores = [far_light(proposal) for proposal in asked]
        strategy.tell(asked, scores)
        told += scores
    return told


def test_branches_that_fail_are_tried_more():
    scores = played(Mcts(NARROW, 0), 12)
    assert sum(score.failed for score in scores[-64:]) > 0.6 * 64


@pytest.mark.parametrize(("extent", "low", "high"), [("nominal", 0, 0), ("near", 0, 0.5), ("far", 0.5, 1)])
def test_an_extent_says_how_far_a_gene_is_from_nominal(extent: str, low: float, high: float):
    (gene,) = [gene for gene in space().genes if gene.path == "light.intensity"]
    for where in np.random.default_rng(0).random(50):
        level = int(_perturbed(gene, where, extent) * gene.grid.size)
        assert low - 0.02 <= gene.distance(gene.grid.value(level)) <= high + 0.02


def test_what_was_not_judged_leaves_no_trace():
    strategy = Mcts(space(), 0)
    strategy.tell(strategy.ask(6), [Score(Verdict.INVALID, None, 0.0)] * 6)
    assert (strategy._root.visits, strategy._root.failures) == (0, 0)


def test_the_tree_is_bounded(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(mcts, "MOST_NODES", 8)
    strategy = Mcts(NARROW, 0)
    strategy.ask(64)
    assert strategy._nodes == 8
