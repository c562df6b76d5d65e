"""Workers on ray: the rules are those of processes, and an actor that dies is replaced, too."""

import importlib.util
import os
import signal
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from tests.doubles import ClosedForm
from tests.rollouts.models import Counter
from tests.rollouts.test_processes import BRIGHT, DARK, Treacherous, of_bright, same
from vlafuzz.errors import PrerequisiteError, UsageError, install
from vlafuzz.model import Outcome, Verdict
from vlafuzz.policies.base import EpisodeStart, Observation, Policy
from vlafuzz.rollouts.ray import RayExecutor
from vlafuzz.rollouts.registry import Place
from vlafuzz.rollouts.shared import share
from vlafuzz.worlds.evaluator import Evaluator

pytestmark = pytest.mark.usefixtures("connected")
MODELS = "python:tests.rollouts.models"


@pytest.fixture
def executor() -> Iterator[Callable[..., RayExecutor]]:
    with ExitStack() as stack:

        def make(evaluator: Evaluator, workers: int = 1, **more: Any) -> RayExecutor:
            return stack.enter_context(closing(RayExecutor(partial(same, evaluator), workers, **more)))

        yield make


def kill_actor() -> None:
    """The worker is forked from a server, which the actor has started."""
    server = Path(f"/proc/{os.getppid()}/stat").read_text()
    os.kill(int(server.rpartition(")")[2].split()[1]), signal.SIGKILL)


def test_an_actor_that_is_killed_costs_one_more_try_and_then_only_its_scene(executor, tmp_path, capfd):
    outcome = of_bright(executor(Treacherous(kill_actor, tmp_path, always=True)))
    assert (outcome.verdict, outcome.detail) == (Verdict.ERROR, "worker: its actor died, 2 times")
    assert len(list(tmp_path.iterdir())) == 2
    assert capfd.readouterr().out == ""


def load() -> Evaluator:
    raise ModuleNotFoundError("No module named 'mine'")


class Foreign(ClosedForm):
    """Cannot be loaded in another process."""

    def __reduce__(self) -> tuple[object, ...]:
        return (load, ())


def test_a_machine_that_lacks_a_package_says_so(executor):
    ((_, outcome),) = executor(Foreign()).run([(0, DARK)])
    assert outcome.detail == "worker: its actor died: ModuleNotFoundError: No module named 'mine', 2 times"


class Named(ClosedForm):
    """Writes a file with the id of its process, and never ends."""

    def __init__(self, folder: Path) -> None:
        super().__init__()
        self._folder = folder

    def evaluate(self, scenes: object) -> list[Outcome]:
        (self._folder / str(os.getpid())).touch()
        signal.pause()
        return []


def test_nobody_is_left_when_it_is_closed(executor, tmp_path):
    chosen = executor(Named(tmp_path), timeout=1.0)
    dict(chosen.run([(0, DARK)]))
    chosen.close()
    assert len(list(tmp_path.iterdir())) == 2
    assert not any(Path(f"/proc/{pid.name}").exists() for pid in tmp_path.iterdir())


class Asking(ClosedForm):
    """Calls a policy once per scene."""

    def __init__(self, policy: Policy) -> None:
        super().__init__()
        self._policy = policy

    def outcome(self, scene: object) -> Outcome:
        self._policy.reset([EpisodeStart("one", "move", "pick-up", 0)])
        (chunk,) = self._policy.act([Observation("one", 0, "move")])
        return Outcome.error(f"asked {chunk.actions[0, 0]:g} times")


def test_actors_share_a_policy_too(executor):
    policy = share(f"{MODELS}:{Counter.__name__}", everywhere=True)
    got = dict(executor(Asking(policy), workers=2, after=policy.close).run([(0, DARK), (1, BRIGHT)]))
    assert [outcome.detail for outcome in got.values()] == ["asked 1 times"] * 2


def test_more_workers_than_the_cluster_has_room_for_are_refused():
    with pytest.raises(UsageError, match="--workers 3: the ray cluster has 2 CPUs"):
        RayExecutor(ClosedForm, 3)


def test_ray_that_is_not_installed_is_one_sentence(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(PrerequisiteError, match="--executor ray needs the package 'ray'") as caught:
        Place(executor="ray").check()
    assert caught.value.hint == install("ray")
