"""What every strategy keeps, whatever it searches for."""

from collections.abc import Callable

import numpy as np
import pytest

from tests.search.worlds import CATALOGUE, space as tabletop
from tests.worlds.reacher import Reacher
from vlafuzz.errors import UsageError
from vlafuzz.model import Verdict
from vlafuzz.search.base import Proposal, Strategy
from vlafuzz.search.proposals import InOrder
from vlafuzz.search.registry import STRATEGIES, strategy_factory
from vlafuzz.search.scoring import Score
from vlafuzz.worlds.tabletop.fairness import check_static
from vlafuzz.worlds.values import Parameter

SPACE = Reacher().space("reach", "own")  # values: none of this depends on the world
MAKERS = {name: lambda seed, make=make: make(SPACE, seed, 120) for name, make in STRATEGIES.items()}
MAKERS["pool"] = lambda seed: InOrder(500)
strategies = pytest.mark.parametrize("name", MAKERS)
shipped = pytest.mark.parametrize("name", STRATEGIES)
guided = pytest.mark.parametrize("name", [name for name in STRATEGIES if name not in ("random", "severity")])


class Digits(Reacher):
    """A world of ten scenes."""

    parameters = (Parameter("digit", options=tuple("0123456789")),)

    def unfair(self, values: object) -> None: ...


def mixed(proposal: Proposal) -> Score:
    """Something of everything, always the same of one genome."""
    kind = int(proposal.genome.sum() * 1000) % 8
    if kind < 2:
        return Score(Verdict(kind), None, 1.0)
    if kind < 4:
        return Score(Verdict.FAILED, kind / 8, float(proposal.genome[0]), cell=f"grasp|base|x{kind}y0")
    return Score(Verdict.PASSED, 1.0, float(proposal.genome[0]), slack=1 / kind)


def play(strategy: Strategy, *batches: int, judge: Callable[[Proposal], Score] = mixed) -> list[Proposal]:
    proposals = []
    for batch in batches:
        asked = strategy.ask(batch)
        strategy.tell(asked, [judge(proposal) for proposal in asked])
        proposals += asked
    return proposals


def genomes(proposals: list[Proposal]) -> list[list[float]]:
    return [proposal.genome.tolist() for proposal in proposals]


@strategies
class TestStrategy:
    def test_it_proposes_at_most_as_many_as_asked_for_with_consecutive_ids(self, name: str):
        proposals = play(MAKERS[name](0), 5, 0, 1, 7, 40, 3)
        assert [proposal.id for proposal in proposals] == list(range(len(proposals)))
        assert len(proposals) == 56 or (name == "causes" and 5 < len(proposals) < 56)  # it waits for outcomes

    def test_a_genome_is_a_vector_of_the_space(self, name: str):
        for proposal in play(MAKERS[name](0), 20, 20):
            assert proposal.genome.dtype == np.float64
            assert proposal.genome.shape == ((1,) if name == "pool" else (SPACE.dim,))
            assert name == "pool" or ((proposal.genome >= 0) & (proposal.genome <= 1)).all()

    @pytest.mark.parametrize("batches", [(8,) * 5, (16, 1, 40, 3)])
    def test_one_seed_and_the_same_scores_are_one_run(self, name: str, batches: tuple[int, ...]):
        one, other = play(MAKERS[name](3), *batches), play(MAKERS[name](3), *batches)
        assert genomes(one) == genomes(other)

    def test_it_leaves_the_global_generator_alone(self, name: str):
        before = np.random.get_state()[1].tolist()  # noqa: NPY002
        play(MAKERS[name](0), 8, 8, 8)
        assert np.random.get_state()[1].tolist() == before  # noqa: NPY002

    @pytest.mark.parametrize("verdict", Verdict)
    def test_it_goes_on_when_one_verdict_is_all_there_is(self, name: str, verdict: Verdict):
        progress = {Verdict.FAILED: 0.0, Verdict.PASSED: 1.0}.get(verdict)
        proposals = play(MAKERS[name](0), *(16,) * 5, judge=lambda _: Score(verdict, progress, 0.5))
        assert [proposal.id for proposal in proposals] == list(range(len(proposals)))
        assert len(proposals) >= 5  # one that waits for outcomes may give fewer than it is asked for

    def test_batches_may_be_out_before_earlier_ones_are_told(self, name: str):
        strategy = MAKERS[name](0)
        told = 0
        for _ in range(4):
            first, second = strategy.ask(10), strategy.ask(10)
            for batch in (first, second):
                strategy.tell(batch, [mixed(proposal) for proposal in batch])
                told += len(batch)
        assert [proposal.id for proposal in strategy.ask(1)] == [told]


@shipped
@pytest.mark.parametrize("budget", [None, 1, 17, 10_000])
def test_a_run_may_go_on_beyond_its_budget_or_have_none(name: str, budget: int | None):
    assert len(play(STRATEGIES[name](SPACE, 0, budget), *(16,) * 4)) > 17


@shipped
def test_a_space_that_runs_out_of_scenes_gives_known_ones_again(name: str):
    tiny = Digits().space("reach", "own")
    strategy = STRATEGIES[name](tiny, 0, 48)
    scores = {}
    for _ in range(12):
        asked = strategy.ask(16)
        strategy.tell(asked, [scores.setdefault(tiny.decode(p.genome).digest, mixed(p)) for p in asked])
    assert len(scores) == 10


@guided
def test_no_scene_is_proposed_twice_while_there_are_others(name: str):
    proposals = play(MAKERS[name](0), *(16,) * 12)
    assert len({SPACE.decode(proposal.genome).digest for proposal in proposals}) == len(proposals) > 12


@pytest.mark.parametrize("task", ["move-near", "put-in"])
@pytest.mark.parametrize("name", STRATEGIES)
def test_every_proposal_is_fair_as_far_as_can_be_told_without_a_simulator(name: str, task: str):
    one = tabletop(task)
    for proposal in play(STRATEGIES[name](one, 0, 64), *(16,) * 4):
        assert check_static(one.decode(proposal.genome), CATALOGUE, 0.15) is None


@guided
def test_scores_make_a_difference_from_the_second_batch_on(name: str):
    one, other = (play(MAKERS[name](0), *(16,) * 4, judge=judge) for judge in (mixed, passing))
    assert genomes(one[:16]) == genomes(other[:16])
    assert genomes(one[16:]) != genomes(other[16:])


def passing(_: Proposal) -> Score:
    return Score(Verdict.PASSED, 1.0, 0.5)


@pytest.mark.parametrize("seed", [0, 1, 2**63])
def test_random_draws_the_same_whatever_the_batches(seed: int):
    one, other = play(MAKERS["random"](seed), 12), play(MAKERS["random"](seed), 5, 5, 2)
    assert [p.genome.tolist() for p in one] == [p.genome.tolist() for p in other]


def test_a_pool_proposes_its_scenes_in_order_and_ends():
    assert [proposal.genome.tolist() for proposal in play(InOrder(5), 3, 3, 3)] == [[0], [1], [2], [3], [4]]


def test_an_unknown_strategy_is_refused_with_the_nearest_known():
    with pytest.raises(UsageError, match="unknown strategy 'randon'") as caught:
        strategy_factory("randon")
    assert caught.value.hint == "did you mean 'random'?"


def test_the_pool_is_asked_for_by_its_scenes():
    with pytest.raises(UsageError, match="needs a file of scenes"):
        strategy_factory("pool")


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
