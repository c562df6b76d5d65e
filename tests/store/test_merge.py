import sqlite3
from itertools import starmap
from pathlib import Path

import pytest

from tests.doubles import begun, failed, manifest, passed, trial
from vlafuzz.errors import StoreError
from vlafuzz.model import Outcome
from vlafuzz.store.merge import NUMBERS, Merged, merge
from vlafuzz.store.records import Trial
from vlafuzz.store.store import Store


def store(path: Path, *runs: tuple[str, dict[int, Outcome]]) -> Path:
    with Store.open(path, "write") as opened:
        for policy, outcomes in runs:
            number = begun(opened, *starmap(trial, outcomes.items()), about=manifest(policy=policy))
            opened.finish(number, "finished", 2.0)
    return path


@pytest.fixture
def two(tmp_path: Path) -> list[Path]:
    one = store(tmp_path / "one.db", ("idle", {0: failed(), 1: passed(), 2: failed(0.75)}))
    other = store(tmp_path / "other.db", ("idle", {2: failed(), 3: failed(repeats=2)}), ("else", {0: failed()}))
    return [one, other]


def trials(path: Path) -> list[list[tuple[object, ...]]]:
    def told(one: Trial) -> tuple[object, ...]:
        rollouts = [(rolled.progress, rolled.trace.tolist()) for rolled in one.outcome.rollouts]
        return one.proposal, one.scene, one.outcome.verdict, one.genome.tolist(), rollouts

    with Store.open(path) as store:
        return [list(map(told, store.trials(run.id))) for run in store.runs()]


def test_all_runs_and_trials_are_there_as_they_were(two: list[Path], tmp_path: Path):
    merged = merge(two, tmp_path / "out.db")
    assert merged == Merged(runs=3, trials=6, findings=4)
    assert trials(tmp_path / "out.db") == trials(two[0]) + trials(two[1])
    with Store.open(tmp_path / "out.db") as store:
        assert [(run.id, run.manifest.policy, run.status) for run in store.runs()] == [
            (1, "idle", "finished"), (2, "idle", "finished"), (3, "else", "finished"),
        ]  # fmt: skip


def test_a_finding_known_in_both_is_kept_once_for_its_policy(two: list[Path], tmp_path: Path):
    merge(two, tmp_path / "out.db")
    with Store.open(tmp_path / "out.db") as store:
        found = [(each.run, each.policy_key.split(":")[0]) for each in store.findings()]
        assert found == [(1, "idle"), (1, "idle"), (2, "idle"), (3, "else")]
        assert len(store.findings(2)) == 2


def test_a_merged_store_is_one_that_can_be_written_and_gone_on_with(two: list[Path], tmp_path: Path):
    merge(two, tmp_path / "out.db")
    with Store.open(tmp_path / "out.db", "write") as store:
        assert store.begin(manifest()) == 4
        assert store.known(trial(1, passed()).scene, manifest().key()) is not None
    with sqlite3.connect(tmp_path / "out.db") as raw:
        assert raw.execute("PRAGMA foreign_key_check").fetchall() == []
    raw.close()


def test_every_table_is_merged(tmp_path: Path):
    with sqlite3.connect(store(tmp_path / "a.db")) as raw:
        tables = {name for (name,) in raw.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
    raw.close()
    assert tables == set(NUMBERS)


def test_an_existing_file_is_refused_and_left_alone(two: list[Path], tmp_path: Path):
    (tmp_path / "out.db").write_text("mine")
    with pytest.raises(StoreError, match=r"out\.db: exists already"):
        merge(two, tmp_path / "out.db")
    assert (tmp_path / "out.db").read_text() == "mine"


@pytest.mark.parametrize("spoil", [Path.unlink, lambda path: path.write_bytes(path.read_bytes()[:9000])])
def test_a_store_that_cannot_be_read_leaves_nothing_behind(two: list[Path], tmp_path: Path, spoil):
    spoil(two[1])
    with pytest.raises(StoreError, match=r"other\.db: "):
        merge(two, tmp_path / "out.db")
    assert {path.name for path in tmp_path.iterdir()} <= {"one.db", "other.db"}


def test_what_a_killed_merge_left_does_not_matter(two: list[Path], tmp_path: Path):
    (tmp_path / "out.db.part").write_text("half")
    (tmp_path / "out.db.part-wal").write_text("half")
    assert merge(two, tmp_path / "out.db").trials == 6
    assert {path.name for path in tmp_path.iterdir()} == {"one.db", "other.db", "out.db"}


def test_a_store_that_is_being_written_is_merged_as_it_is_at_that_moment(two: list[Path], tmp_path: Path):
    with Store.open(two[0], "write") as store:
        store.add(store.begin(manifest()), trial(7, passed()))
        assert merge(two, tmp_path / "out.db") == Merged(runs=4, trials=7, findings=4)


def test_a_store_that_a_run_is_writing_is_no_place_for_it(two: list[Path], tmp_path: Path):
    with Store.open(tmp_path / "out.db", "write"), pytest.raises(StoreError, match="is writing to it"):
        merge(two, tmp_path / "out.db")
