"""What every executor keeps, wherever it evaluates."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from functools import partial

import pytest

from tests.doubles import Always, ClosedForm, Idle, Raising, scene
from tests.rollouts.test_processes import same
from vlafuzz.errors import PolicyError, PrerequisiteError
from vlafuzz.model import Outcome, Scene, Verdict
from vlafuzz.rollouts.executor import Executor, LocalExecutor
from vlafuzz.rollouts.lockstep import LockstepExecutor
from vlafuzz.rollouts.processes import ProcessExecutor
from vlafuzz.worlds.evaluator import Evaluator


def on_ray(evaluator: Evaluator) -> Executor:
    from vlafuzz.rollouts.ray import RayExecutor

    return RayExecutor(partial(same, evaluator), workers=1)


MAKERS: dict[str, Callable[[Evaluator], Executor]] = {
    "local": LocalExecutor,
    "lockstep": lambda evaluator: LockstepExecutor(lambda _: evaluator, Idle(), lanes=2),
    "processes": lambda evaluator: ProcessExecutor(partial(same, evaluator), workers=1),
    "ray": on_ray,
}
DARK, BRIGHT, FAR = scene(light=0.25), scene(light=4.0), scene(x=0.1)


def run(executor: Executor, *scenes: Scene) -> dict[int, Verdict]:
    return {tag: outcome.verdict for tag, outcome in executor.run(enumerate(scenes))}


@pytest.fixture(params=["local", "lockstep", "processes", "ray"], scope="module")
def kind(request: pytest.FixtureRequest) -> str:
    if request.param == "ray":
        request.getfixturevalue("connected")
    return request.param


@pytest.fixture
def make(kind: str) -> Iterator[Callable[[Evaluator], Executor]]:
    """Makes executors of a kind, and closes them."""
    with ExitStack() as stack:
        yield lambda evaluator: stack.enter_context(closing(MAKERS[kind](evaluator)))


here = pytest.mark.parametrize("kind", ["local", "lockstep", "processes"], indirect=True)
"""Of what a process of an actor does for ray: it starts one for every test, which takes seconds."""


class TestExecutor:
    def test_each_scene_has_its_outcome(self, make):
        got = run(make(ClosedForm()), DARK, BRIGHT, FAR)
        assert got == {0: Verdict.FAILED, 1: Verdict.PASSED, 2: Verdict.INVALID}

    @here
    def test_where_there_is_no_scene_yet_it_asks_again_after_an_outcome(self, make):
        done: list[int] = []

        def scenes() -> Iterator[tuple[int, Scene] | None]:
            for tag, light in enumerate([DARK, BRIGHT, FAR]):
                while len(done) < tag:
                    yield None
                yield tag, light

        for tag, _ in make(ClosedForm()).run(scenes()):
            done.append(tag)
        assert done == [0, 1, 2]

    def test_an_evaluator_that_raises_is_an_error_and_the_rest_goes_on(self, make):
        evaluator = Raising(PolicyError("no answer within 10 s"), after=1)
        results = dict(make(evaluator).run(enumerate([DARK, BRIGHT, FAR])))
        assert results[0].verdict is Verdict.FAILED
        assert results[1].detail == "PolicyError: no answer within 10 s"
        assert results[2].verdict is Verdict.ERROR

    @here
    def test_progress_that_is_not_a_number_is_an_error(self, make):
        broken = Outcome(verdict=Verdict.FAILED, progress=float("nan"))
        assert run(make(Always(broken)), DARK) == {0: Verdict.ERROR}

    @here
    def test_it_can_be_run_again(self, make):
        executor = make(ClosedForm())
        assert [run(executor, DARK), run(executor, BRIGHT)] == [{0: Verdict.FAILED}, {0: Verdict.PASSED}]

    @pytest.mark.parametrize("error", [KeyboardInterrupt(), PrerequisiteError("no renderer", "install one")])
    def test_an_interruption_and_a_missing_installation_pass(self, make, error):
        with pytest.raises(type(error)):
            run(make(Raising(error)), DARK)


def test_the_local_executor_pulls_a_scene_when_the_one_before_is_taken():
    pulled = []

    def scenes():
        for tag in range(3):
            pulled.append(tag)
            yield tag, DARK

    results = LocalExecutor(ClosedForm()).run(scenes())
    next(results)
    assert pulled == [0]
    next(results)
    assert pulled == [0, 1]
