"""What differs between two processes is found and named: physics, pictures and answers."""

import numpy as np
import pytest

from tests.doctor.planted import SPEC
from tests.policies.clients.served import seen, start
from tests.policies.clients.test_openpi import scripted
from vlafuzz.campaign.config import RunConfig, plan
from vlafuzz.doctor import Check
from vlafuzz.doctor.probes import Moment
from vlafuzz.doctor.two_processes import Rolled, check_answers, check_simulation, on_answers, on_physics, on_pictures
from vlafuzz.policies.base import CameraRequest
from vlafuzz.rollouts.policies import make_policy

PLANTED = "python:tests.doctor.planted"
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


def test_two_connections_to_a_server_that_samples_say_how_far_its_actions_spread():
    replies = [{"actions": np.full((1, 7), 0.001 * number)} for number in range(8)]
    with scripted(*replies) as (name, requests):
        check = checked(f"{name}?camera=0", remote=True)
    assert len(requests) == 8
    assert check.verdict == "ok"
    assert check.found.startswith("it samples, as declared: its actions spread by ")


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


def test_states_and_pixels_that_differ_are_counted():
    picture = np.zeros((4, 5, 3), np.uint8)
    changed = picture.copy()
    changed[1, 2, 0], changed[3, 3] = 7, 200
    one = Rolled("a", np.zeros((9, 7), np.float32), {"front": picture})
    other = Rolled("b", np.where(np.arange(9)[:, None] < 6, 0, 0.5).astype(np.float32), {"front": changed})
    assert on_physics(one, one).verdict == on_pictures(one.pictures, one.pictures).verdict == "ok"
    physics, pictures = on_physics(one, other), on_pictures(one.pictures, other.pictures)
    assert physics.found.endswith("the actions from step 6 on, by up to 0.5")
    assert pictures.found == "2 of 20 pixels differ between two processes, by up to 200 of 255"
    assert physics.verdict == pictures.verdict == "warn"


@pytest.mark.slow
@pytest.mark.render
def test_this_machine_rolls_out_and_draws_alike_in_two_processes():
    manifest = plan(RunConfig(policy="expert")).manifest
    checks = list(check_simulation(manifest, [CameraRequest("front", 64, 64)]))
    assert [check.verdict for check in checks] == ["ok", "ok"]
    assert checks[1].found == "all 4096 pixels are equal in two processes"
