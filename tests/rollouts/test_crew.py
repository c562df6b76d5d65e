"""Several findings at a time behind a server: one thread simulates, and their rollouts share its answers."""

from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest

from tests.rollouts.test_scene_runner import BATCHES, SEEDS, run
from tests.worlds.tabletop.sim.scenes import nominal
from vlafuzz.common.plugins import EVERYTHING, trusting
from vlafuzz.model import Verdict
from vlafuzz.rollouts.crew import Crew, crew_at
from vlafuzz.rollouts.registry import Place
from vlafuzz.rollouts.scene_runner import SimulatorSceneRunner


@pytest.fixture
def crew() -> Iterator[Crew]:
    SEEDS.clear()
    BATCHES.clear()
    conditions = run("make_remote")
    make = partial(SimulatorSceneRunner, Path("a.db"), conditions)
    with trusting(EVERYTHING), crew_at(Place(), make, conditions.policy) as crew:
        yield crew


def test_rollouts_that_several_ask_for_are_answered_together(crew):
    shared, each = crew

    def function(number: int) -> list[Verdict]:
        outcomes = [*shared.evaluate([nominal()], [number]), *shared.evaluate([nominal()] * 2, [number] * 2)]
        return [outcome.verdict for outcome in outcomes]

    results = dict(each(function, [0, 1, 2]))
    assert results == {number: [Verdict.FAILED] * 3 for number in (0, 1, 2)}
    assert max(BATCHES) == 4
    assert sum(BATCHES) == 9 * 80
    assert sorted(SEEDS) == sorted([8, 9, 10] * 3)


def test_the_expert_works_for_whoever_asks(crew):
    shared, each = crew

    def function(attempt: int) -> Verdict:
        solved = shared.solve(nominal(), attempt)
        shared.evaluate([nominal()], [attempt])
        return shared.play(nominal(), solved.rollouts[0].actions).verdict

    assert dict(each(function, [0, 1])) == dict.fromkeys((0, 1), Verdict.PASSED)


def test_an_error_of_one_ends_all_and_is_raised(crew):
    shared, each = crew

    def function(number: int) -> None:
        shared.evaluate([nominal()], [number])
        if number == 1:
            raise ZeroDivisionError
        for again in range(100):
            shared.evaluate([nominal()], [again])

    with pytest.raises(ZeroDivisionError):
        list(each(function, [0, 1, 2]))


def test_an_interruption_ends_all(crew, monkeypatch):
    shared, each = crew
    monkeypatch.setattr(SimulatorSceneRunner, "solve", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))

    def function(number: int) -> None:
        shared.evaluate([nominal()], [number])
        shared.solve(nominal(), 0)

    with pytest.raises(KeyboardInterrupt):
        list(each(function, [0, 1, 2]))
