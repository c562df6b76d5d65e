"""Workers that die or hang cost a retry, then an ERROR, and never the run."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, closing
from functools import partial
from multiprocessing import active_children
from pathlib import Path

import pytest

from tests.doubles import ClosedForm, scene
from vlafuzz.errors import PrerequisiteError, UsageError
from vlafuzz.model import Outcome, Scene, Verdict
from vlafuzz.rollouts import processes
from vlafuzz.rollouts.processes import ProcessExecutor
from vlafuzz.rollouts.worker_pool import Worker, WorkerPool
from vlafuzz.worlds.evaluator import Evaluator

DARK, BRIGHT = scene(light=0.25), scene(light=4.0)
OTHERS = [scene(light=2.0**power) for power in (-3, -1, 0, 1, 2.5, 3)]


class Treacherous(ClosedForm):
    """Misbehaves in one scene, the first time only or always; ``folder`` remembers across processes."""

    def __init__(self, what: Callable[[], None], folder: Path, *, always: bool, where: Scene = BRIGHT) -> None:
        super().__init__()
        self._what, self._folder, self._always, self._where = what, folder, always, where

    def evaluate(self, scenes: Sequence[Scene]) -> list[Outcome]:
        if self._where in scenes:
            (self._folder / str(os.getpid())).touch()
            if self._always or len(list(self._folder.iterdir())) == 1:
                self._what()
        return super().evaluate(scenes)


def die() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def leave() -> None:
    os._exit(7)


def hang() -> None:
    time.sleep(600)


def same(evaluator: Evaluator) -> Evaluator:
    return evaluator


def thread_numbers() -> Evaluator:
    class Threads(ClosedForm):
        def evaluate(self, scenes: Sequence[Scene]) -> list[Outcome]:
            return [Outcome.error(os.environ["OMP_NUM_THREADS"])]

    return Threads()


def broken() -> Evaluator:
    os._exit(3)


def missing() -> Evaluator:
    raise UsageError("'mimi': no such policy", hint="did you mean 'mini'?")


@pytest.fixture
def executor() -> Iterator[Callable[..., ProcessExecutor]]:
    with ExitStack() as stack:
        yield lambda make, workers=2, **more: stack.enter_context(closing(ProcessExecutor(make, workers, **more)))


def of_bright(executor: WorkerPool) -> Outcome:
    """The outcome of a bright scene; the other scenes must have their usual outcomes."""
    scenes = [*OTHERS[:3], BRIGHT, *OTHERS[3:]]
    got = dict(executor.run(enumerate(scenes)))
    assert len(got) == len(scenes)
    bright = got.pop(3)
    expected = [outcome.verdict for outcome in ClosedForm().evaluate(OTHERS)]
    assert [outcome.verdict for _, outcome in sorted(got.items())] == expected
    return bright


TROUBLES = {
    "killed": (die, {}, "worker: was killed by SIGKILL, 2 times"),
    "gone": (leave, {}, "worker: ended with exit code 7, 2 times"),
    "hung": (hang, {"timeout": 2.0}, "worker: no answer within 2 s, 2 times"),
}


@pytest.mark.parametrize("trouble", TROUBLES)
@pytest.mark.parametrize("always", [False, True], ids=["once", "always"])
def test_a_worker_in_trouble_costs_one_more_try_and_then_only_its_scene(executor, tmp_path, trouble, always):
    what, options, says = TROUBLES[trouble]
    outcome = of_bright(executor(partial(same, Treacherous(what, tmp_path, always=always)), **options))
    assert (outcome.verdict, outcome.detail) == ((Verdict.ERROR, says) if always else (Verdict.PASSED, ""))
    assert len(list(tmp_path.iterdir())) == 2


def test_a_simulator_that_dies_when_it_is_made_is_an_error_of_every_scene(executor):
    got = dict(executor(broken).run([(0, DARK), (1, BRIGHT)]))
    details = {outcome.detail for outcome in got.values()}
    assert details == {"worker: ended with exit code 3, 2 times"}


@pytest.mark.parametrize("deaths", [1, 2])
def test_a_server_of_forks_that_dies_gets_one_more_try_and_is_no_interruption(executor, monkeypatch, deaths):
    left, context = [EOFError] * deaths, processes.forks.context

    def dying():
        if left:
            raise left.pop()
        return context()

    monkeypatch.setattr(processes.forks, "context", dying)
    results = executor(partial(same, ClosedForm()), workers=1).run([(0, BRIGHT)])
    if deaths == 1:
        assert [outcome.verdict for _, outcome in results] == [Verdict.PASSED]
    else:
        with pytest.raises(PrerequisiteError, match="no worker process starts: EOFError"):
            list(results)


def test_what_the_user_has_to_mend_first_is_raised_as_it_is(executor):
    with pytest.raises(UsageError, match="'mimi': no such policy") as caught:
        list(executor(missing).run([(0, DARK)]))
    assert caught.value.hint == "did you mean 'mini'?"


def test_workers_have_one_thread_and_this_process_keeps_its_own(executor, monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    ((_, outcome),) = executor(thread_numbers, workers=1).run([(0, DARK)])
    assert (outcome.detail, os.environ["OMP_NUM_THREADS"]) == ("1", "3")


def test_scenes_are_pulled_only_when_a_worker_is_free(executor):
    pulled = []

    def scenes() -> Iterator[tuple[int, Scene]]:
        for tag in range(9):
            pulled.append(tag)
            yield tag, DARK

    results = executor(partial(same, ClosedForm()), workers=2).run(scenes())
    next(results)
    assert len(pulled) <= 4
    assert len(list(results)) == 8


def test_the_first_scene_is_proposed_before_the_workers_start():
    happened: list[str] = []

    def scenes() -> Iterator[tuple[int, Scene]]:
        happened.append("proposed")
        yield 0, DARK

    def start() -> Worker:
        happened.append("started")
        raise UsageError("no simulator")

    pool = WorkerPool(start, lambda workers, seconds: None, 1, lambda: None)
    with pytest.raises(UsageError, match="no simulator"):
        list(pool.run(scenes()))
    assert happened == ["proposed", "started"]


def test_nobody_is_left_when_it_is_closed_or_given_up(executor):
    chosen = executor(partial(same, Treacherous(hang, Path("/nowhere"), always=True)), workers=2)
    results = chosen.run([(0, DARK), (1, OTHERS[0])])
    next(results)
    pids = [process.pid for process in active_children()]
    results.close()
    assert len(pids) == 2
    assert not any(Path(f"/proc/{pid}").exists() for pid in pids)


SCRIPT = """
import os, time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from vlafuzz.rollouts import forks

if __name__ == "__main__":
    environment = dict(os.environ)
    with ProcessPoolExecutor(1, get_context("forkserver"), forks.settle_in, (environment,)) as pool:
        print(pool.submit(os.getpid).result(), flush=True)
        time.sleep(60)
"""


def is_there(process: int) -> bool:
    stat = Path(f"/proc/{process}/stat")
    return stat.exists() and stat.read_text().rpartition(")")[2].split()[0] != "Z"


def test_a_worker_that_waits_for_work_ends_when_its_parent_is_killed(tmp_path: Path):
    (tmp_path / "waits.py").write_text(SCRIPT)
    with subprocess.Popen([sys.executable, str(tmp_path / "waits.py")], stdout=subprocess.PIPE) as parent:
        assert parent.stdout is not None
        worker = int(parent.stdout.readline())
        assert is_there(worker)
        os.kill(parent.pid, signal.SIGKILL)
    deadline = time.monotonic() + 30
    while is_there(worker) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not is_there(worker)
