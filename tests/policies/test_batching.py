"""One policy for many callers gives each of them the answers that it would get alone."""

from collections.abc import Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from threading import Event

import numpy as np
import pytest

from tests.rollouts.models import Counter
from vlafuzz.errors import PolicyError
from vlafuzz.policies.base import ActionChunk, EpisodeStart, Observation
from vlafuzz.policies.batching import Answer, BatchingPolicy, Request, ServedPolicy

START = EpisodeStart("1/scene", "move", "pick-up", 0)


def begun(policy: Counter, *callers: int) -> BatchingPolicy:
    batching = BatchingPolicy(policy)
    assert batching.answer([(caller, Request(begin=[START])) for caller in callers]) == [[] for _ in callers]
    return batching


def act(instruction: str = "move", times: int = 1) -> Request:
    return Request(act=[Observation(START.episode, 0, instruction)] * times)


def summary(answers: list[Answer]) -> list[object]:
    def told(answer: Answer) -> object:
        return (answer.message, answer.cause) if isinstance(answer, PolicyError) else [c.actions[0, 0] for c in answer]

    return list(map(told, answers))


def test_rollouts_of_the_same_name_do_not_meet():
    batching = begun(Counter(), 1, 2)
    batching.answer([(1, act())])
    assert summary(batching.answer([(1, act()), (2, act())])) == [[2.0], [1.0]]


def test_an_error_reaches_who_asked_and_nobody_else():
    batching = begun(Counter(), 1, 2, 3)
    answers = summary(batching.answer([(1, act()), (2, act("jump")), (3, act())]))
    assert answers == [[1.0], ("counter raised ValueError: cannot jump", "remote"), [1.0]]


def test_a_rollout_that_cannot_begin_is_an_error_of_who_began_it():
    sit = EpisodeStart("1/scene", "sit", "pick-up", 0)
    answers = BatchingPolicy(Counter()).answer([(1, Request(begin=[sit])), (2, Request(begin=[START]))])
    assert summary(answers) == [("counter raised ValueError: cannot sit", "remote"), []]


def test_a_rollout_is_finished_when_it_is_over_or_its_caller_gone():
    policy = Counter()
    batching = begun(policy, 1, 2, 12)
    batching.answer([(2, Request(over=[START.episode]))])
    assert policy.finished == ["2/1/scene"]
    batching.leave(1)
    assert policy.finished == ["2/1/scene", "1/1/scene"]


LONG = 60.0  # seconds: whoever waits that long is stuck


def rolling(policy: Counter, callers: int, patience: float = LONG) -> ServedPolicy:
    """A policy with as many live rollouts, whose callers are threads."""
    served = ServedPolicy(policy, lambda took: patience)
    for caller in range(callers):
        served.ask(caller, Request(begin=[START]))
    return served


def at_once(served: ServedPolicy, callers: int) -> list[float]:
    with ThreadPoolExecutor(callers) as pool:
        answers = pool.map(lambda caller: served.ask(caller, act()), range(callers), timeout=LONG)
        return [float(chunk.actions[0, 0]) for (chunk,) in answers]


def test_a_question_waits_for_all_rollouts_that_there_are():
    assert at_once(rolling(policy := Counter(), 3), 3) == [1.0, 1.0, 1.0]
    assert policy.batches == [3]


def test_no_more_than_the_policy_takes_is_waited_for():
    at_once(rolling(policy := Counter(max_batch=2), 3), 2)
    assert policy.batches == [2]


def test_a_call_has_no_more_than_the_policy_takes_and_an_answer_does_not_wait_for_later_calls():
    class Held(Counter):
        def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
            assert len(self.batches) < 2 or first.wait(LONG)
            return super().act(observations)

    served, first = rolling(policy := Held(max_batch=2), 2, patience=0.5), Event()
    with ThreadPoolExecutor(2) as pool:
        asked = [pool.submit(served.ask, caller, act(times=3)) for caller in range(2)]
        assert wait(asked, LONG, FIRST_COMPLETED).done or first.set()  # so that the threads end
        first.set()
    assert policy.batches == [2, 1, 2, 1]


def test_rollouts_that_are_over_and_callers_that_are_gone_are_not_waited_for():
    served = rolling(policy := Counter(), 3)
    served.ask(1, Request(over=[START.episode]))
    served.leave(2)
    served.ask(0, act())
    assert (policy.batches, policy.finished) == ([1], ["1/1/scene", "2/1/scene"])


def test_one_that_says_nothing_is_not_waited_for_long():
    assert at_once(rolling(policy := Counter(), 2, patience=0.01), 1) == [1.0]
    assert policy.batches == [1]


def test_what_breaks_the_policy_for_good_leaves_nobody_waiting():
    class Gone(Counter):
        def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
            raise KeyboardInterrupt

    served = rolling(Gone(), 1)
    with pytest.raises(KeyboardInterrupt):
        served.ask(0, act())
    assert np.array_equal(served.ask(0, Request(over=[START.episode])), [])
