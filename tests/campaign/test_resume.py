"""A run that ends early and is gone on with comes to what it would have come to: the same to the last row."""

import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.campaign.resuming import SPACE, Climber, Moody, Steady, contents, cut, play, timeless
from tests.doubles import STAGES, Backwards, ClosedForm, Raising, Scripted, manifest, rollout, scene  # fmt: skip
from vlafuzz.common.deadline import Deadline
from vlafuzz.errors import StoreError
from vlafuzz.model import Outcome
from vlafuzz.rollouts.executor import LocalExecutor
from vlafuzz.search.proposals import Random
from vlafuzz.store.store import Store


@pytest.mark.parametrize("kind", [Climber, Steady])
@pytest.mark.parametrize("after", range(0, 34, 3))
def test_wherever_it_is_cut_it_comes_to_the_same(tmp_path: Path, after: int, kind: type[Climber]):
    whole, parted = tmp_path / "whole.db", tmp_path / "parted.db"
    expected = play(whole, strategy=kind())
    cut(parted, after, strategy=kind())
    again = play(parted, resume=1, strategy=kind())
    assert contents(parted) == contents(whole)
    assert timeless(again, whole) == timeless(expected, whole)
    assert expected.duplicates > 3
    assert expected.findings > 3
    assert expected.verdicts["error"] > 0


def test_a_run_whose_time_is_over_says_so_and_is_gone_on_with(tmp_path: Path):
    class Impatient(Deadline):
        """Passes after ten scenes."""

        looked = 0

        @property
        def passed(self) -> bool:
            self.looked += 1
            return self.looked > 10

    whole, parted = tmp_path / "whole.db", tmp_path / "parted.db"
    expected = play(whole)
    first = play(parted, deadline=Impatient())
    assert 0 < first.proposals < expected.proposals
    assert first.stopped == "its time is over; with --resume it goes on"
    assert timeless(play(parted, resume=1), whole) == timeless(expected, whole)
    assert contents(parted) == contents(whole)


def test_it_may_be_cut_again_and_again(tmp_path: Path):
    whole, parted = tmp_path / "whole.db", tmp_path / "parted.db"
    play(whole)
    cut(parted, 4)
    for _ in range(5):
        cut(parted, 4, resume=1)
    play(parted, resume=1)
    assert contents(parted) == contents(whole)


def test_what_is_stored_is_not_run_again(tmp_path: Path):
    path, evaluator = tmp_path / "a.db", ClosedForm()
    parts = {"about": manifest(budget=8, batch=8), "strategy": Random(SPACE, 0)}
    with pytest.raises(KeyboardInterrupt):
        play(path, executor=LocalExecutor(Raising(KeyboardInterrupt(), after=5)), **parts)
    play(path, resume=1, executor=LocalExecutor(evaluator), **parts | {"strategy": Random(SPACE, 0)})
    with Store.open(path) as store:
        first = [trial.scene for trial in store.trials(1)][:5]
        assert len(list(store.trials(1))) == len({trial.scene for trial in store.trials(1)})
    assert not set(first) & set(evaluator.evaluated)


@pytest.mark.parametrize("kind", [Climber, Steady])
def test_a_batch_of_which_the_last_was_done_first_is_completed(tmp_path: Path, kind: type[Climber]):
    whole, parted = tmp_path / "whole.db", tmp_path / "parted.db"
    play(whole, strategy=kind(), executor=Backwards(Moody()))
    cut(parted, 10, Backwards, strategy=kind())
    play(parted, resume=1, strategy=kind(), executor=Backwards(Moody()))
    assert contents(parted) == contents(whole)


def test_a_strategy_is_told_again_what_it_was_told(tmp_path: Path):
    genomes = [SPACE.encode(each) for each in (scene(0.25), scene(), scene(0.25), scene(2.0), scene())]
    told = []
    for after in (99, 1, 2):
        path = tmp_path / f"{after}.db"
        if after < 99:
            cut(path, after, strategy=Scripted(genomes), about=manifest(batch=2))
        strategy = Scripted(genomes)
        play(path, resume=1 if after < 99 else None, strategy=strategy, about=manifest(batch=2))
        told.append(strategy.told)
    assert told[1] == told[2] == told[0]
    assert len(told[0]) == 5


def test_a_duplicate_is_told_with_what_it_was_answered_with_then(tmp_path: Path):
    path, about = tmp_path / "a.db", manifest(batch=1)
    genomes = [SPACE.encode(each) for each in (scene(), scene(4.0), scene(), scene(2.0), scene(16.0))]
    cut(path, 3, strategy=Scripted(genomes), about=about)
    slower = Outcome.of((rollout(steps=9),), STAGES)
    with Store.open(path, "write") as store:  # another run has seen it otherwise since
        seen = next(iter(store.trials(1)))
        store.add(store.begin(about), replace(seen, outcome=slower))
    strategy = Scripted(genomes)
    play(path, resume=1, strategy=strategy, about=about)
    assert [score.slack for _, score in strategy.told] == [0.25] * 5


def test_the_stop_rule_counts_what_came_before(tmp_path: Path):
    whole, parted = tmp_path / "whole.db", tmp_path / "parted.db"
    genomes = [SPACE.encode(scene(x=0.08, y=0.05 * (number % 9 - 4))) for number in range(200)]
    parts = {"about": manifest(budget=99, batch=8), "patience": 20}
    expected = play(whole, strategy=Scripted(genomes), **parts)
    cut(parted, 7, strategy=Scripted(genomes), **parts)
    assert play(parted, resume=1, strategy=Scripted(genomes), **parts).stopped == expected.stopped is not None
    assert contents(parted) == contents(whole)


@pytest.mark.parametrize(
    "strategy",
    [Climber(1), Scripted([]), Scripted([np.full(3, 0.5)] * 9), Random(SPACE, 3)],
    ids=["another seed", "nothing", "one thing for ever", "another strategy"],
)
def test_another_strategy_than_then_is_refused_and_changes_nothing(tmp_path: Path, strategy):
    path = tmp_path / "a.db"
    cut(path, 12)
    before = contents(path)[:2]
    with pytest.raises(StoreError, match="run 1 was made by another version") as caught:
        play(path, resume=1, strategy=strategy)
    assert "leave out --resume" in str(caught.value.hint)
    assert contents(path)[:2] == before


def test_a_run_that_is_over_is_not_gone_on_with(tmp_path: Path):
    play(tmp_path / "a.db")
    with pytest.raises(StoreError, match="run 1 is over"):
        play(tmp_path / "a.db", resume=1)


def test_one_hears_once_of_what_was_stored_and_then_of_every_trial(tmp_path: Path):
    cut(tmp_path / "a.db", 12)
    seen: list[int] = []
    play(tmp_path / "a.db", resume=1, watch=lambda tally: seen.append(tally.proposals))
    with Store.open(tmp_path / "a.db") as store:
        assert seen[0] >= 12
        assert seen == list(range(seen[0], store.extent(1)[0] + 1))


def test_its_seconds_are_those_of_all_parts(tmp_path: Path):
    cut(tmp_path / "a.db", 12)
    with Store.open(tmp_path / "a.db", "write") as store:
        store.finish(1, "interrupted", 1000.0)
    summary = play(tmp_path / "a.db", resume=1)
    assert 1000 < summary.seconds < 1060


RUN = """
import sys, time
from pathlib import Path
from tests.campaign.resuming import Moody, play
from vlafuzz.rollouts.executor import LocalExecutor

class Slow(Moody):
    def evaluate(self, scenes):
        print(len(self.evaluated), flush=True)
        time.sleep(0.02)
        return super().evaluate(scenes)

play(Path(sys.argv[1]), executor=LocalExecutor(Slow()))
"""


def test_a_run_that_was_killed_is_gone_on_with_as_if_it_had_not_been(tmp_path: Path):
    whole, parted, after = tmp_path / "whole.db", tmp_path / "parted.db", 17
    root, command = Path(__file__).parents[1], [sys.executable, "-c", RUN, str(parted)]
    expected = play(whole)
    with subprocess.Popen(command, cwd=root, text=True, stdout=subprocess.PIPE) as child:
        assert child.stdout is not None
        for _ in range(after + 1):
            child.stdout.readline()
        os.kill(child.pid, signal.SIGKILL)
    with Store.open(parted) as store:
        assert store.runs()[0].status == "running"
        assert after <= store.extent(1)[0] < len(contents(whole)[0])
    again = play(parted, resume=1)
    assert contents(parted) == contents(whole)
    assert timeless(again, whole) == timeless(expected, whole)


@pytest.fixture
def small_disk(tmp_path: Path):
    """A disk of 640 kB, and how to make it larger."""
    disk = tmp_path / "disk"
    disk.mkdir()
    if os.geteuid() != 0 or mount("-t", "tmpfs", "-o", "size=640k", "tmpfs", str(disk)):
        pytest.skip("only root may mount a small disk, and not everywhere")
    yield disk, lambda: mount("-o", "remount,size=8m", str(disk))
    subprocess.run(["umount", str(disk)], check=True)


def mount(*arguments: str) -> int:
    return subprocess.run(["mount", *arguments], capture_output=True, check=False).returncode


def test_a_full_disk_ends_it_in_a_sentence_and_with_more_room_it_goes_on(tmp_path: Path, small_disk):
    whole, (disk, enlarge) = tmp_path / "whole.db", small_disk
    stored: list[int] = []
    about = manifest(budget=120, batch=7)
    play(whole, about=about)
    with pytest.raises(StoreError, match=r"disk is full|cannot be read or written") as caught:
        play(disk / "a.db", about=about, watch=lambda tally: stored.append(tally.proposals))
    assert "all trials up to here are stored" in str(caught.value.hint)
    enlarge()
    with Store.open(disk / "a.db") as store:
        assert store.extent(1)[0] == stored[-1] > 10
    play(disk / "a.db", about=about, resume=1)
    assert contents(disk / "a.db") == contents(whole)


def test_nothing_is_left_to_run_when_it_was_cut_at_its_very_end(tmp_path: Path):
    path = tmp_path / "a.db"
    expected = play(path)
    with Store.open(path, "write") as store:
        store.finish(1, "interrupted", 0.0)
    summary = play(path, resume=1, executor=LocalExecutor(Raising(AssertionError("run again"))))
    assert timeless(summary, path) == timeless(expected, path)
