import numpy as np
import pytest

from tests.search.toy import Toy
from tests.search.worlds import EASY, judged, space, toy
from vlafuzz.model import Verdict
from vlafuzz.search.nsga2 import SMALLEST, Nsga2
from vlafuzz.search.scoring import Score

EARLY = Score(Verdict.FAILED, 0.1, 2.0)
LATE = Score(Verdict.FAILED, 0.6, 2.0)
HARD = Score(Verdict.PASSED, 1.0, 0.1, slack=0.01)
SIMPLE = Score(Verdict.PASSED, 1.0, 0.1, slack=0.5)
BROKEN = (Score(Verdict.ERROR, None, 0.0), Score(Verdict.INVALID, None, 0.0))


def population(strategy: Nsga2) -> list[Score]:
    return list(strategy._population.get("score"))


def dominates(one: tuple[float, ...], other: tuple[float, ...]) -> bool:
    return all(a <= b for a, b in zip(one, other, strict=True)) and one != other


@pytest.mark.parametrize(
    ("better", "worse"), [((EARLY, 0.0), (LATE, 0.0)), ((LATE, 0.0), (HARD, 9.0)), ((HARD, 0.0), (SIMPLE, 9.0))]
)
def test_early_failures_come_before_late_ones_and_all_of_them_before_passes(better, worse):
    assert dominates(Nsga2._objectives(*better), Nsga2._objectives(*worse))


def test_among_failures_low_severity_and_novelty_are_merits():
    mild = Score(Verdict.FAILED, 0.6, 1.0)
    assert dominates(Nsga2._objectives(mild, 0.0), Nsga2._objectives(LATE, 0.0))
    assert dominates(Nsga2._objectives(LATE, 1.0), Nsga2._objectives(LATE, 0.5))
    assert not dominates(Nsga2._objectives(EARLY, 0.0), Nsga2._objectives(mild, 0.0))
    assert not dominates(Nsga2._objectives(EARLY, 0.0), Nsga2._objectives(LATE, 0.5))


def test_what_was_not_judged_survives_only_where_nothing_else_is_left():
    strategy = Nsga2(space(), 0, 100)
    asked = strategy.ask(SMALLEST + 3)
    strategy.tell(asked, [BROKEN[0], BROKEN[1], BROKEN[0]] + [SIMPLE] * (SMALLEST - 1) + [EARLY])
    strategy.tell(strategy.ask(1), [BROKEN[1]])
    verdicts = sorted(score.verdict for score in population(strategy))
    assert verdicts == [Verdict.PASSED] * (SMALLEST - 1) + [Verdict.FAILED]


@pytest.mark.parametrize(
    ("budget", "says"),
    [(60, "of 6, 10 generations"), (100, "of 8, 12 generations"), (300, "of 20, 15 generations"), (None, "of 64")],
)
def test_a_budget_has_room_for_ten_generations_and_it_says_so(budget: int | None, says: str):
    assert Nsga2(space(), 0, budget).about == f"population {says}"


def test_the_population_moves_toward_failures():
    evaluator, strategy = toy(EASY, 0.02), Nsga2(space(), 0, 160)
    eases = [np.mean([score.ease for score in told(strategy, evaluator)]) for _ in range(10)]
    assert eases[-1] < eases[0] - 0.5


def told(strategy: Nsga2, evaluator: Toy) -> list[Score]:
    asked = strategy.ask(16)
    scores = judged(evaluator, [space().decode(proposal.genome) for proposal in asked], space())
    strategy.tell(asked, scores)
    return population(strategy)


def test_as_long_as_all_scenes_are_alike_they_are_drawn_at_random():
    strategy, other = Nsga2(space(), 0, 100), Nsga2(space(), 0, 100)
    for _ in range(3):
        asked = strategy.ask(16)
        strategy.tell(asked, [SIMPLE] * 16)
        assert [p.genome.tolist() for p in asked] == [p.genome.tolist() for p in other.ask(16)]
