"""Several findings at a time behind a server: one thread simulates, and their rollouts share its answers."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.failures.triage.test_scene_runner import BATCHES, SEEDS, run
from tests.worlds.tabletop.sim.scenes import nominal
from vlafuzz.common.plugins import EVERYTHING, trusting
from vlafuzz.failures.triage.scene_runner import SimulatorSceneRunner
from vlafuzz.failures.triage.shared_runner import SharedRunner
from vlafuzz.model.outcome import Verdict


@pytest.fixture
def runner() -> Iterator[SimulatorSceneRunner]:
    SEEDS.clear()
    BATCHES.clear()
    with trusting(EVERYTHING):
        runner = SimulatorSceneRunner(Path("a.db"), run("make_remote"))
        yield runner
        runner.close()


def test_rollouts_that_several_ask_for_are_answered_together(runner):
    shared = SharedRunner(runner)

    def function(number: int) -> tuple[int, list[Verdict]]:
        outcomes = [*shared.evaluate([nominal()], [number]), *shared.evaluate([nominal()] * 2, [number] * 2)]
        return number, [outcome.verdict for outcome in outcomes]

    results = dict(shared.side_by_side(function, [0, 1, 2]))
    assert results == {number: [Verdict.FAILED] * 3 for number in (0, 1, 2)}
    assert max(BATCHES) == 4
    assert sum(BATCHES) == 9 * 80
    assert sorted(SEEDS) == sorted([8, 9, 10] * 3)


def test_the_expert_works_for_whoever_asks(runner):
    shared = SharedRunner(runner)

    def function(attempt: int) -> Verdict:
        solved = shared.solve(nominal(), attempt)
        shared.evaluate([nominal()], [attempt])
        return shared.play(nominal(), solved.rollouts[0].actions).verdict

    assert list(shared.side_by_side(function, [0, 1])) == [Verdict.PASSED] * 2


def test_an_error_of_one_ends_all_and_is_raised(runner):
    shared = SharedRunner(runner)

    def function(number: int) -> None:
        shared.evaluate([nominal()], [number])
        if number == 1:
            raise ZeroDivisionError
        for again in range(100):
            shared.evaluate([nominal()], [again])

    with pytest.raises(ZeroDivisionError):
        list(shared.side_by_side(function, [0, 1, 2]))


def test_an_interruption_ends_all(runner, monkeypatch):
    shared = SharedRunner(runner)
    monkeypatch.setattr(runner, "solve", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))

    def function(number: int) -> None:
        shared.evaluate([nominal()], [number])
        shared.solve(nominal(), 0)

    with pytest.raises(KeyboardInterrupt):
        list(shared.side_by_side(function, [0, 1, 2]))
