"""Simultaneous requests of several connections are one call of the policy, with the same answers."""

import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from threading import Barrier
from typing import TypeVar

import numpy as np
import pytest

from tests.policies.clients.served import Attentive, seen, start
from tests.rollouts.models import Counter
from vlafuzz.policies.base import ActionChunk, EpisodeStart, Observation
from vlafuzz.policies.batching import Request, ServedPolicy
from vlafuzz.policies.serving.serve import serving
from vlafuzz.rollouts.policies import make_policy

CLIENTS, STEPS = 8, 4
LONG = 60.0  # seconds: whoever waits that long is stuck
Result = TypeVar("Result")


def at_once(work: Callable[[int], Result], clients: int = CLIENTS) -> list[Result]:
    """The results of as many simultaneous threads."""
    ready = Barrier(clients)
    with ThreadPoolExecutor(clients) as pool:
        return list(pool.map(lambda number: (ready.wait(), work(number))[1], range(clients), timeout=LONG))


class Slow(Attentive):
    """A slow policy, so that others send requests meanwhile."""

    def __init__(self, **more: object) -> None:
        super().__init__(**more)
        self.batches: list[int] = []

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        self.batches.append(len(observations))
        time.sleep(0.02)
        return super().act(observations)


def act(instruction: str = "move") -> Request:
    return Request(act=[Observation("one", 0, instruction)])


def rolling(policy: Counter, callers: int, wait: float = LONG) -> ServedPolicy:
    """A gatherer with as many live rollouts."""
    gathered = ServedPolicy(policy, wait)
    for caller in range(callers):
        gathered.ask(caller, Request(begin=[EpisodeStart("one", "move", "pick-up", 0)]))
    return gathered


@pytest.mark.usefixtures("opened")
def test_clients_that_ask_at_the_same_time_get_the_answers_that_each_gets_alone():
    def rollout(policy, number: int) -> list[list[list[float]]]:
        policy.reset([start("it", number)])
        return [policy.act([seen("it", step)])[0].actions.tolist() for step in range(STEPS)]

    served = Slow(max_batch=CLIENTS)
    with serving(served) as name:
        clients = [make_policy(name) for _ in range(CLIENTS)]
        there = at_once(lambda number: rollout(clients[number], number))
        for client in clients:
            client.close()
    assert there == [rollout(Attentive(), number) for number in range(CLIENTS)]
    assert max(served.batches) > 1
    assert sum(served.batches) == CLIENTS * STEPS


def test_a_question_waits_for_all_rollouts_that_there_are():
    gathered = rolling(policy := Counter(), 3)
    answers = at_once(lambda caller: gathered.ask(caller, act()), 3)
    assert policy.batches == [3]
    assert [chunk.actions[0, 0] for (chunk,) in answers] == [1.0, 1.0, 1.0]


def test_no_more_than_the_policy_takes_is_waited_for():
    gathered = rolling(policy := Counter(max_batch=2), 3)
    at_once(lambda caller: gathered.ask(caller, act()), 2)
    assert policy.batches == [2]


def test_rollouts_that_are_over_are_not_waited_for():
    gathered = rolling(policy := Counter(), 2)
    gathered.ask(1, Request(over=["one"]))
    gathered.ask(0, act())
    assert (policy.batches, policy.finished) == ([1], ["1/one"])


def test_one_that_says_nothing_is_not_waited_for_long():
    gathered = rolling(policy := Counter(), 2, wait=0.01)
    assert gathered.ask(0, act())[0].actions[0, 0] == 1.0
    assert policy.batches == [1]


def test_what_breaks_the_policy_for_good_leaves_nobody_waiting():
    class Gone(Counter):
        def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
            raise KeyboardInterrupt

    gathered = ServedPolicy(Gone())
    gathered.ask(0, Request(begin=[EpisodeStart("one", "move", "pick-up", 0)]))
    with pytest.raises(KeyboardInterrupt):
        gathered.ask(0, act())
    assert np.array_equal(gathered.ask(0, Request(over=["one"])), [])
