import numpy as np

from tests.search.worlds import space
from vlafuzz.model import Verdict
from vlafuzz.search import feedback
from vlafuzz.search.feedback import Bandit, Feedback
from vlafuzz.search.scoring import Score

OPERATORS = ("light", "camera-position", "target-type")


def failing(cell: str, severity: float = 1.0) -> Score:
    return Score(Verdict.FAILED, 0.2, severity, cell=cell)


def passing(slack: float, severity: float = 1.0) -> Score:
    return Score(Verdict.PASSED, 1.0, severity, slack=slack)


def told(*scores: Score) -> Feedback:
    strategy = Feedback(space(), 0, 100)
    strategy.tell(strategy.ask(len(scores)), scores)
    return strategy


def test_a_place_keeps_its_least_severe_scene():
    (seed,) = told(failing("a", 2.0), failing("a", 1.0), failing("a", 3.0))._seeds.values()
    assert (seed.score.severity, seed.hits) == (1.0, 3)


def test_passes_that_are_nearly_as_late_are_in_one_place():
    assert len(told(passing(0.1), passing(0.099), passing(0.03))._seeds) == 2


def test_rare_places_have_more_energy():
    strategy = told(*[failing("often")] * 30, failing("rarely"))
    rare = space().decode(strategy._seeds["rarely"].genome)
    children = [space().decode(strategy._child(np.random.default_rng(n))[0]) for n in range(100)]
    assert sum(child.targets[0].object == rare.targets[0].object for child in children) > 60


def test_places_are_bounded_and_the_one_reached_most_goes_first(monkeypatch):
    monkeypatch.setattr(feedback, "MOST_SEEDS", 3)
    strategy = told(*map(failing, "abbcd"))
    assert list(strategy._seeds) == ["a", "c", "d"]


def test_a_bandit_learns_what_pays():
    bandit, rng = Bandit(), np.random.default_rng(0)
    for _ in range(200):
        chosen = bandit.choose(OPERATORS, rng)
        bandit.learn(chosen, float(chosen == ("light",)))
    chosen = [bandit.choose(OPERATORS, rng)[0] for _ in range(100)]
    assert chosen.count("light") > 70
