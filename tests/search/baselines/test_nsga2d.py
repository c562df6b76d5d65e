import pytest

from tests.search.test_nsga2 import EARLY, HARD, LATE, SIMPLE, dominates, population
from tests.search.worlds import space
from vlafuzz.model.outcome import Verdict
from vlafuzz.search.nsga2 import Nsga2D
from vlafuzz.search.scoring import Score


def failing(cell: str) -> Score:
    return Score(Verdict.FAILED, 0.3, 1.0, cell=cell)


def grown(*batches: list[Score]) -> Nsga2D:
    strategy = Nsga2D(space(), 0, 300)  # a population of 20
    for scores in batches:
        strategy.tell(strategy.ask(len(scores)), scores)
    return strategy


@pytest.mark.parametrize("score", [EARLY, LATE, HARD, SIMPLE])
def test_distance_from_known_failures_is_a_merit_of_every_scene(score: Score):
    assert dominates(Nsga2D._objectives(score, 1.0), Nsga2D._objectives(score, 0.5))


def test_a_pass_far_from_all_failures_may_stay_beside_a_failure():
    assert not dominates(Nsga2D._objectives(EARLY, 0.1), Nsga2D._objectives(HARD, 1.0))


def test_when_no_new_cell_is_reached_for_a_generation_half_the_population_leaves():
    strategy = grown([failing("a")] * 20, [failing("a")] * 19)
    assert len(population(strategy)) == 20
    strategy.tell(strategy.ask(1), [failing("a")])
    assert len(population(strategy)) == 10


def test_a_new_cell_lets_it_go_on():
    strategy = grown([failing("a")] * 20, [failing("a")] * 19, [failing("b")], [failing("a")] * 19)
    assert len(population(strategy)) == 20
