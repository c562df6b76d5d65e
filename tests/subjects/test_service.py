"""One subject for many callers answers each of them as it would have alone."""

from tests.execute.models import Counter
from vlafuzz.errors import SubjectError
from vlafuzz.subjects.base import EpisodeStart, Observation
from vlafuzz.subjects.service import Answer, Asked, Service

ONE = EpisodeStart("1/scene", "move", "pick-up", 0)


def begun(subject: Counter, *callers: int) -> Service:
    service = Service(subject)
    assert service.answer([(caller, Asked(begin=[ONE])) for caller in callers]) == [[] for _ in callers]
    return service


def act(instruction: str = "move") -> Asked:
    return Asked(act=[Observation(ONE.episode, 0, instruction)])


def told(answers: list[Answer]) -> list[object]:
    return [
        (each.message, each.cause) if isinstance(each, SubjectError) else [c.actions[0, 0] for c in each]
        for each in answers
    ]


def test_what_arrives_together_is_asked_in_one_call():
    subject = Counter()
    service = begun(subject, 1, 2, 3)
    assert told(service.answer([(3, act()), (1, act()), (2, act())])) == [[1.0], [1.0], [1.0]]
    assert subject.batches == [3]


def test_a_call_has_no_more_than_the_subject_takes():
    subject = Counter(max_batch=2)
    begun(subject, 1, 2, 3).answer([(caller, act()) for caller in (1, 2, 3)])
    assert subject.batches == [2, 1]


def test_rollouts_of_the_same_name_do_not_meet():
    service = begun(Counter(), 1, 2)
    service.answer([(1, act())])
    assert told(service.answer([(1, act()), (2, act())])) == [[2.0], [1.0]]


def test_an_error_reaches_who_asked_and_nobody_else():
    service = begun(Counter(), 1, 2, 3)
    answers = told(service.answer([(1, act()), (2, act("jump")), (3, act())]))
    assert answers == [[1.0], ("counter raised ValueError: cannot jump", "remote"), [1.0]]


def test_a_rollout_that_cannot_begin_is_an_error_of_who_began_it():
    sit = EpisodeStart("1/scene", "sit", "pick-up", 0)
    answers = Service(Counter()).answer([(1, Asked(begin=[sit])), (2, Asked(begin=[ONE]))])
    assert told(answers) == [("counter raised ValueError: cannot sit", "remote"), []]


def test_a_rollout_is_finished_when_it_is_over_or_its_caller_gone():
    subject = Counter()
    service = begun(subject, 1, 2, 12)
    service.answer([(2, Asked(over=[ONE.episode]))])
    assert subject.finished == ["2/1/scene"]
    service.leave(1)
    assert subject.finished == ["2/1/scene", "1/1/scene"]
