"""What every executor keeps, wherever it evaluates."""

from collections.abc import Callable

import pytest

from tests.doubles import Always, ClosedForm, Raising, passed, scene
from vlafuzz.errors import PrerequisiteError, SubjectError
from vlafuzz.execute.base import Executor
from vlafuzz.execute.local import LocalExecutor
from vlafuzz.outcome import Outcome, Verdict
from vlafuzz.sim.base import Evaluator

MAKERS: dict[str, Callable[[Evaluator], Executor]] = {"local": LocalExecutor}
DARK, BRIGHT, FAR = scene(light=0.25), scene(light=4.0), scene(x=0.1)


def run(executor: Executor, *batches) -> dict[int, list[Verdict]]:
    return {tag: [each.verdict for each in outcomes] for tag, outcomes in executor.run(enumerate(batches))}


@pytest.mark.parametrize("make", MAKERS.values(), ids=MAKERS)
class TestExecutor:
    def test_each_batch_has_its_outcomes_in_order(self, make):
        got = run(make(ClosedForm()), [DARK, BRIGHT], [FAR], [])
        assert got == {0: [Verdict.FAILED, Verdict.PASSED], 1: [Verdict.INVALID], 2: []}

    def test_an_evaluator_that_raises_is_an_error_and_the_rest_goes_on(self, make):
        evaluator = Raising(SubjectError("no answer within 10 s"), after=1)
        results = dict(make(evaluator).run(enumerate([[DARK], [DARK, BRIGHT], [FAR]])))
        assert [outcome.verdict for outcome in results[0]] == [Verdict.FAILED]
        assert [outcome.detail for outcome in results[1]] == ["SubjectError: no answer within 10 s"] * 2
        assert [outcome.verdict for outcome in results[2]] == [Verdict.ERROR]

    def test_an_evaluator_that_loses_a_scene_is_an_error(self, make):
        evaluator = Always(passed())
        evaluator.evaluate = lambda scenes: [passed()]  # type: ignore[method-assign]
        ((_, outcomes),) = make(evaluator).run([(0, [DARK, BRIGHT])])
        assert [outcome.detail for outcome in outcomes] == ["the evaluator gave 1 outcomes for 2 scenes"] * 2

    def test_progress_that_is_not_a_number_is_an_error(self, make):
        broken = Outcome(Verdict.FAILED, progress=float("nan"))
        assert run(make(Always(broken)), [DARK]) == {0: [Verdict.ERROR]}

    @pytest.mark.parametrize("error", [KeyboardInterrupt(), PrerequisiteError("no renderer", "install one")])
    def test_an_interruption_and_a_missing_installation_pass(self, make, error):
        with pytest.raises(type(error)):
            run(make(Raising(error)), [DARK])


def test_the_local_executor_pulls_a_batch_when_the_one_before_is_taken():
    pulled = []

    def batches():
        for tag in range(3):
            pulled.append(tag)
            yield tag, [DARK]

    results = LocalExecutor(ClosedForm()).run(batches())
    next(results)
    assert pulled == [0]
    next(results)
    assert pulled == [0, 1]
