"""What every strategy keeps, whatever it searches for."""

from collections.abc import Callable

import numpy as np
import pytest

from tests.doubles import TinySpace, scene
from vlafuzz.errors import UsageError
from vlafuzz.outcome import Verdict
from vlafuzz.scoring import Score
from vlafuzz.search.base import Proposal, Strategy
from vlafuzz.search.pool import InOrder, Pool
from vlafuzz.search.registry import STRATEGIES, strategy_factory

MAKERS: dict[str, Callable[[int], Strategy]] = {
    name: lambda seed, factory=factory: factory(TinySpace(), seed) for name, factory in STRATEGIES.items()
}
MAKERS["pool"] = lambda seed: InOrder(100)


def play(strategy: Strategy, *batches: int) -> list[Proposal]:
    proposals = []
    for batch in batches:
        asked = strategy.ask(batch)
        strategy.tell(asked, [Score(Verdict.PASSED, 0.5, float(proposal.genome[0])) for proposal in asked])
        proposals += asked
    return proposals


@pytest.mark.parametrize("name", MAKERS)
class TestStrategy:
    def test_it_proposes_as_many_as_asked_for_with_consecutive_ids(self, name: str):
        assert [proposal.id for proposal in play(MAKERS[name](0), 5, 0, 1, 7)] == list(range(13))

    def test_a_genome_is_a_vector_of_the_space(self, name: str):
        for proposal in play(MAKERS[name](0), 20):
            assert proposal.genome.dtype == np.float64
            assert proposal.genome.shape == ((1,) if name == "pool" else (3,))
            assert name == "pool" or ((proposal.genome >= 0) & (proposal.genome <= 1)).all()

    def test_one_seed_proposes_one_thing(self, name: str):
        one, other = play(MAKERS[name](3), 8, 8), play(MAKERS[name](3), 8, 8)
        assert [p.genome.tolist() for p in one] == [p.genome.tolist() for p in other]

    def test_it_leaves_the_global_generator_alone(self, name: str):
        before = np.random.get_state()[1].tolist()  # noqa: NPY002
        play(MAKERS[name](0), 8, 8)
        assert np.random.get_state()[1].tolist() == before  # noqa: NPY002


@pytest.mark.parametrize("seed", [0, 1, 2**63])
def test_random_draws_the_same_whatever_the_batches(seed: int):
    one, other = play(MAKERS["random"](seed), 12), play(MAKERS["random"](seed), 5, 5, 2)
    assert [p.genome.tolist() for p in one] == [p.genome.tolist() for p in other]


def test_random_draws_other_scenes_with_another_seed():
    one, other = play(MAKERS["random"](0), 10), play(MAKERS["random"](1), 10)
    assert [p.genome.tolist() for p in one] != [p.genome.tolist() for p in other]


def test_a_pool_proposes_its_scenes_in_order_and_ends():
    scenes = [scene(x=0.01 * number) for number in range(5)]
    pool = Pool(scenes, TinySpace())
    asked = play(InOrder(5), 3, 3, 3)
    assert [pool.decode(proposal.genome) for proposal in asked] == scenes


def test_a_pool_finds_its_scenes_again():
    pool = Pool([scene(x=0.01 * number) for number in range(5)], TinySpace())
    drawn = pool.sample(np.random.default_rng(0))
    assert pool.decode(pool.encode(drawn)) == drawn


def test_an_unknown_strategy_is_refused_with_the_nearest_known():
    with pytest.raises(UsageError, match="unknown strategy 'randon'") as caught:
        strategy_factory("randon")
    assert caught.value.hint == "did you mean 'random'?"


def test_the_pool_is_asked_for_by_its_scenes():
    with pytest.raises(UsageError, match="needs a file of scenes"):
        strategy_factory("pool")


def test_a_strategy_of_ones_own_is_named_by_module_and_factory():
    assert strategy_factory("python:tests.doubles:Scripted").__name__ == "Scripted"


@pytest.mark.parametrize(
    ("reference", "says"),
    [
        ("python:tests.doubles", "names no factory"),
        ("python:no_such_module:make", "no module 'no_such_module'"),
        ("python:tests.no_such:make", "no module 'tests.no_such'"),
        ("python:tests.doubles:Scriptde", "no callable 'Scriptde'"),
        ("python:tests.doubles:STAGES", "no callable 'STAGES'"),
    ],
)
def test_a_reference_that_leads_nowhere_is_refused(reference: str, says: str):
    with pytest.raises(UsageError, match=says) as caught:
        strategy_factory(reference)
    assert caught.value.hint
