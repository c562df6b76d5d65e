"""Workers do what one process does, with a policy each or one that they share in a process of its own."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from functools import partial
from multiprocessing import Process, active_children, get_context
from pathlib import Path
from typing import Any

import pytest

from tests.rollouts.models import Counter, Sleeper, deadly, refused, unmade
from vlafuzz.campaign import config
from vlafuzz.errors import PolicyError, UsageError
from vlafuzz.policies.base import EpisodeStart, Observation
from vlafuzz.policies.harness import Harness
from vlafuzz.rollouts.policies import is_shared
from vlafuzz.rollouts.shared import PolicyProcess, SharedPolicy, share
from vlafuzz.rollouts.worker_pool import Lost
from vlafuzz.store.store import Store

MODELS = "python:tests.rollouts.models"


@pytest.fixture
def hosted() -> Iterator[Callable[..., Callable[[], SharedPolicy]]]:
    """``hosted(make)()``: a shared policy of a process."""
    with ExitStack() as stack:

        def start_process(make: Callable[[], Counter], **options: Any) -> Callable[[], SharedPolicy]:
            process = stack.enter_context(closing(PolicyProcess("counter", make, **options)))
            return partial(SharedPolicy, "counter", process.address, process.key, process.spec)

        yield start_process


def start(name: str = "scene", instruction: str = "move") -> EpisodeStart:
    return EpisodeStart(name, instruction, "pick-up", 0)


def seen(name: str = "scene", instruction: str = "move") -> Observation:
    return Observation(name, 0, instruction)


def ask(policy: SharedPolicy, name: str = "scene", instruction: str = "move") -> float:
    return float(policy.act([seen(name, instruction)])[0].actions[0, 0])


def trials(store: Path, workers: int, policy: str, executor: str | None = None) -> list[tuple[object, ...]]:
    flags = {"policy": policy, "strategy": "nsga2", "budget": 6, "batch": 3, "seed": 5, "executor": executor}
    summary = config.start(config.plan(config.RunConfig(**flags, store=store, workers=workers)), lambda tally: None)
    assert summary.rollouts == 6
    with Store.open(store) as opened:
        made = [(trial.proposal, trial.scene.digest, trial.outcome) for trial in opened.trials(summary.run)]
    hashes = [[rollout.states_hash for rollout in outcome.rollouts] for *_, outcome in made]
    return sorted((*who, end.verdict, end.progress, *of) for (*who, end), of in zip(made, hashes, strict=True))


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> list[tuple[object, ...]]:
    """The trials of a campaign in one process, with its own model."""
    return trials(tmp_path_factory.mktemp("alone") / "a.db", 1, f"{MODELS}:Own")


@pytest.mark.parametrize("executor", ["processes", pytest.param("ray", marks=pytest.mark.slow)])
def test_two_workers_do_what_one_process_does(tmp_path: Path, alone, executor: str, request):
    if executor == "ray":
        request.getfixturevalue("connected")
    assert trials(tmp_path / "a.db", 2, f"{MODELS}:Own", executor) == alone


def test_a_model_that_takes_its_process_down_costs_one_more_try(tmp_path: Path, monkeypatch, alone):
    """Both workers share it: it is made once, and once more."""
    monkeypatch.chdir(tmp_path)
    assert trials(tmp_path / "b.db", 2, f"{MODELS}:Mortal") == alone
    made = Path("made").read_text().split()
    assert (len(made), str(os.getpid()) in made) == (2, False)


def test_a_rollout_that_begins_anew_counts_from_the_beginning(hosted):
    policy = hosted(Counter)()
    old = Harness(policy, start())
    assert [ask(policy), ask(policy)] == [1, 2]
    new = Harness(policy, start())
    old.finish()
    assert [ask(policy), ask(policy)] == [1, 2]
    new.finish()


def test_an_error_is_the_same_as_without_a_host_and_the_rollout_goes_on(hosted):
    policy = hosted(Counter)()
    policy.reset([start()])
    with pytest.raises(PolicyError, match="counter raised ValueError: cannot jump") as caught:
        ask(policy, instruction="jump")
    assert caught.value.cause == "remote"
    assert ask(policy) == 1


def ask_and_die(policy: SharedPolicy) -> None:
    policy.reset([start("gone")])
    policy._answer = lambda request: (policy._pipe.send(request), os.kill(os.getpid(), signal.SIGKILL))
    policy.act([seen("gone")])


def test_a_worker_that_is_killed_while_it_waits_leaves_the_others_alone(hosted):
    share = hosted(Counter)
    first, dying = share(), share()
    first.reset([start()])
    killed: Process = get_context("spawn").Process(target=ask_and_die, args=(dying,))
    killed.start()
    killed.join()
    assert killed.exitcode == -signal.SIGKILL
    assert [ask(first), ask(first)] == [1, 2]


def test_a_host_that_is_killed_loses_its_rollouts_and_is_there_again(hosted):
    share = hosted(Counter)
    before = share()
    before.reset([start()])
    (process,) = active_children()
    os.kill(process.pid, signal.SIGKILL)
    with pytest.raises(Lost, match="the process of counter died"):
        ask(before)
    after = share()
    after.reset([start()])
    assert ask(after) == 1


def test_a_model_that_never_answers_is_lost_not_waited_for(hosted, capfd):
    policy = hosted(Sleeper, longest=1.0)()
    policy.reset([start()])
    with pytest.raises(Lost, match="the process of counter died"):
        ask(policy)
    assert "in act" in capfd.readouterr().err


@pytest.mark.parametrize(
    ("make", "kind", "says"),
    [
        (refused, UsageError, "no weights"),
        (unmade, UsageError, "the policy cannot be made: OSError: no device"),
        (deadly, PolicyError, "counter: the process that was to make it ended with exit code 4"),
    ],
)
def test_a_model_that_cannot_be_made_is_one_sentence(make, kind, says):
    with pytest.raises(kind, match=f"^{says}$"):
        PolicyProcess("counter", make)
    assert active_children() == []


def test_all_who_share_a_name_share_a_process_until_the_last_is_closed():
    first, second = share(f"{MODELS}:Counter"), share(f"{MODELS}:Counter")
    assert len(active_children()) == 1
    first.close()
    second.reset([start()])
    assert ask(second) == 1
    second.close()
    assert active_children() == []


def test_only_who_says_so_is_shared():
    named = [f"{MODELS}:Common", "lerobot:/policies/mine", f"{MODELS}:Own", "pinhole", "vla-eval:ws://gpu:8000"]
    assert [is_shared(name) for name in named] == [True, True, False, False, False]


def test_nothing_is_left_over_when_the_process_that_shares_is_killed():
    code = """
import os, signal
from tests.doubles import make_idle
from vlafuzz.rollouts.shared import PolicyProcess
print(PolicyProcess("idle", make_idle).address, flush=True)
os.kill(os.getpid(), signal.SIGKILL)
"""
    done = subprocess.run([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True, timeout=60)
    folder, until = Path(done.stdout.strip()).parent, time.monotonic() + 20
    while folder.exists() and time.monotonic() < until:
        time.sleep(0.1)
    assert folder.name.startswith("vlafuzz-")
    assert not folder.exists()
