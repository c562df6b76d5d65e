"""Answers that differ between two processes are found, with their usual reason."""

import os
from collections.abc import Sequence

import numpy as np
import pytest

from tests.policies.clients.served import seen, start
from tests.policies.clients.test_openpi import scripted
from vlafuzz.campaign.config import RunConfig, plan
from vlafuzz.doctor import Check
from vlafuzz.doctor.exam import check_answers
from vlafuzz.doctor.probes import Moment
from vlafuzz.doctor.verdicts import on_answers
from vlafuzz.policies.base import ActionChunk, EpisodeStart, Observation, PolicySpec
from vlafuzz.rollouts.policies import make_policy

PLANTED = "python:tests.doctor.test_answers"
SPEC = PolicySpec("planted", state=True)


class Planted:
    """Answers with its rollout's seed and with what ``more`` gives, centimetres."""

    spec = SPEC

    def __init__(self, more):
        self._more = more

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        self._seed = episodes[0].seed

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        return [ActionChunk(np.full((1, 7), 0.01 * (self._seed + self._more()))) for _ in observations]

    def close(self) -> None:
        pass


def fine() -> Planted:
    return Planted(lambda: 0)


def unseeded() -> Planted:
    return Planted(np.random.random)


def by_process() -> Planted:
    return Planted(lambda: os.getpid() % 1000)


def dying() -> Planted:
    return Planted(lambda: os._exit(1))


MOMENTS = [Moment(start(name, seed), seen(name, seed), np.zeros((1, 7))) for seed, name in enumerate(("one", "two"))]


WORLD = "python:tests.worlds.reacher:Reacher"


@pytest.fixture(autouse=True)
def _trusted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("VLAFUZZ_TRUST", WORLD)


def checked(name: str, *, remote: bool = False) -> Check:
    """The check in a world that takes no time to load."""
    policy = make_policy(name)
    policy.close()
    run = RunConfig(policy=name, task=f"{WORLD}/reach")
    return check_answers(plan(run, policy=policy).manifest, policy.spec, MOMENTS, remote=remote)


@pytest.mark.parametrize(
    ("policy", "verdict", "follows"),
    [
        ("fine", "ok", ""),
        ("unseeded", "warn", "unseeded: it draws from a global generator"),
        ("by_process", "warn", "it depends on its process"),
    ],
)
def test_a_policy_of_ones_own_is_asked_in_two_processes(policy, verdict, follows):
    check = checked(f"{PLANTED}:{policy}")
    assert (check.verdict, check.follows.startswith(follows)) == (verdict, True), check
    says = "two processes get the same answers to 2 observations"
    assert (check.found == says) == (policy == "fine")


def test_two_connections_to_a_server_that_samples_say_how_far_its_answers_differ():
    replies = [{"actions": np.full((1, 7), 0.001 * number)} for number in range(8)]
    with scripted(*replies) as (name, requests):
        check = checked(f"{name}?camera=0", remote=True)
    assert len(requests) == 8
    assert check.verdict == "ok"
    assert check.found.startswith(
        "it samples, as declared: two connections get different answers to 2 of 2 observations"
    )


@pytest.mark.parametrize(
    ("noise", "remote", "follows"),
    [
        (1e-7, False, "autotuned or parallel kernels"),
        (0.01, False, "it depends on its process"),
        (0.01, True, "the server samples"),
    ],
)
def test_an_answer_that_differs_has_its_usual_reason(noise, remote, follows):
    once = [[np.full((1, 7), 0.01), np.full((1, 7), 0.03)]] * 2
    other = [[answer + noise for answer in answers] for answers in once]
    check = on_answers(SPEC, once, other, remote=remote)
    assert check.verdict == "warn"
    assert check.follows.startswith(follows)
    assert "get different answers to 2 of 2 observations" in check.found


def test_a_process_that_dies_is_a_warning():
    check = checked(f"{PLANTED}:dying")
    assert check.verdict == "warn"
    assert check.found.startswith("unknown: ")
