"""One policy for many callers gives each of them the answers that it would get alone."""

from tests.rollouts.models import Counter
from vlafuzz.errors import PolicyError
from vlafuzz.policies.base import EpisodeStart, Observation
from vlafuzz.policies.batching import Answer, BatchingPolicy, Request

START = EpisodeStart("1/scene", "move", "pick-up", 0)


def begun(policy: Counter, *callers: int) -> BatchingPolicy:
    batching = BatchingPolicy(policy)
    assert batching.answer([(caller, Request(begin=[START])) for caller in callers]) == [[] for _ in callers]
    return batching


def act(instruction: str = "move") -> Request:
    return Request(act=[Observation(START.episode, 0, instruction)])


def summary(answers: list[Answer]) -> list[object]:
    return [
        (answer.message, answer.cause) if isinstance(answer, PolicyError) else [c.actions[0, 0] for c in answer]
        for answer in answers
    ]


def test_what_arrives_together_is_asked_in_one_call():
    policy = Counter()
    batching = begun(policy, 1, 2, 3)
    assert summary(batching.answer([(3, act()), (1, act()), (2, act())])) == [[1.0], [1.0], [1.0]]
    assert policy.batches == [3]


def test_a_call_has_no_more_than_the_policy_takes():
    policy = Counter(max_batch=2)
    begun(policy, 1, 2, 3).answer([(caller, act()) for caller in (1, 2, 3)])
    assert policy.batches == [2, 1]


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
