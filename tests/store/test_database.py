"""The file of a store: writers that are killed, files that are damaged, schemas that are old.

The most important test in here kills a writer: what was acknowledged is on the disk.
"""

import errno
import os
import resource
import signal
import sqlite3
import subprocess
import sys
import tempfile
import traceback
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from unittest.mock import Mock

import pytest
from filelock import FileLock

from tests.doubles import failed, stored, trial
from vlafuzz.errors import StoreError
from vlafuzz.store.migrations import STEPS
from vlafuzz.store.store import Store


@pytest.mark.parametrize("name", ["a.db", "link.db"])
def test_a_second_writer_is_told(store: Store, path: Path, name: str):
    path.with_name("link.db").symlink_to(path)
    with pytest.raises(StoreError, match="another process is writing to it"):
        Store.open(path.with_name(name), "write")


def test_neither_writing_nor_reading_leaves_anything_else_in_its_folder(path: Path):
    written(path)
    assert [each.name for each in path.parent.iterdir()] == [path.name]
    with Store.open(path) as store:
        assert len(store.findings()) == 30
    assert [each.name for each in path.parent.iterdir()] == [path.name]


WRITER = """
import sys
from pathlib import Path
from tests.doubles import failed, manifest, trial
from vlafuzz.store.store import Store
with Store.open(Path(sys.argv[1]), "write") as store:
    run = store.begin(manifest())
    for number in range(100_000):
        store.add(run, trial(number, failed()))
        print(number, flush=True)
"""


def start_writer(path: Path, **options) -> subprocess.Popen[str]:
    root = Path(__file__).parents[2]
    command = [sys.executable, "-c", WRITER, str(path)]
    return subprocess.Popen(command, cwd=root, text=True, stdout=subprocess.PIPE, **options)


def test_a_killed_writer_loses_nothing_that_was_acknowledged(path: Path):
    with start_writer(path) as writer:
        assert writer.stdout is not None
        for _ in range(40):
            writer.stdout.readline()
        writer.send_signal(signal.SIGKILL)
        acknowledged = 40 + len(writer.stdout.read().split())
    with Store.open(path, "write") as store:
        kept = list(store.trials(1))
        assert [each.proposal for each in kept[:acknowledged]] == list(range(acknowledged))
        assert len(kept) <= acknowledged + 1
        assert all(len(each.outcome.rollouts) == 1 for each in kept)
        assert len(store.findings()) == len(kept)
        assert store.runs()[0].status == "running"


def test_a_full_disk_is_one_sentence_and_keeps_what_is_stored(path: Path):
    limited = start_writer(path, stderr=subprocess.PIPE, preexec_fn=no_room)
    told, complaint = limited.communicate(timeout=20)
    assert "StoreError" in complaint.splitlines()[-1]
    assert "cannot be read or written" in complaint or "disk is full" in complaint
    with Store.open(path, "write") as store:
        assert len(list(store.trials(1))) == len(told.split())


def no_room() -> None:
    resource.setrlimit(resource.RLIMIT_FSIZE, (300_000, 300_000))


def written(path: Path) -> bytearray:
    return bytearray(stored(path, *(trial(number, failed()) for number in range(30))).read_bytes())


# What is done to the bytes of a store, or in it.
SPOILED = {
    "words": (lambda data: b"words, not a database, however long one reads in it" * 20, "is not a store of vlafuzz"),
    "of others": ("PRAGMA application_id = 0", "is not a store of vlafuzz"),
    "newer": ("PRAGMA user_version = 99", "newer than"),
    "older": ("PRAGMA user_version = 16", r"a\.db: its schema is 16, older than 17, the oldest known here"),
    "truncated": (lambda data: data[: len(data) // 2], "is damaged"),
    "without its last byte": (lambda data: data[:-1], "is damaged"),
    "with a hole": (lambda data: data[:5000] + bytes(10000) + data[15000:], "is damaged"),
}


@pytest.mark.parametrize("mode", ["read", "write"])
@pytest.mark.parametrize("how", SPOILED)
def test_what_cannot_be_used_is_refused_in_a_sentence_and_left_alone(tmp_path: Path, how: str, mode):
    path, (change, says) = tmp_path / "a.db", SPOILED[how]
    data = written(path)
    if isinstance(change, str):
        with closing(sqlite3.connect(path)) as raw:
            raw.execute(change)
    else:
        path.write_bytes(change(data))
    before = path.read_bytes()
    with pytest.raises(StoreError, match=says) as caught:
        Store.open(path, mode)
    assert caught.value.hint
    assert path.read_bytes() == before
    assert not path.with_name("a.db.lock").exists()


@pytest.mark.parametrize(
    ("make", "says"), [(Path.touch, "is empty"), (lambda path: None, "no such store"), (Path.mkdir, "is a folder")]
)
def test_there_is_nothing_to_read_in_an_empty_file_no_file_or_a_folder(tmp_path: Path, make, says: str):
    make(tmp_path / "a.db")
    with pytest.raises(StoreError, match=says) as caught:
        Store.open(tmp_path / "a.db")
    assert caught.value.hint


def test_a_disk_without_room_for_a_lock_is_full_and_nothing_is_left_there(path: Path, monkeypatch):
    monkeypatch.setattr(FileLock, "acquire", Mock(side_effect=OSError(errno.ENOSPC, "No space left on device")))
    with pytest.raises(StoreError, match="the disk is full"):
        Store.open(path, "write")
    assert not list(path.parent.iterdir())


def test_a_folder_that_cannot_be_made_is_a_sentence(tmp_path: Path):
    (tmp_path / "runs").write_text("in the way")
    with pytest.raises(StoreError, match="cannot be written"):
        Store.open(tmp_path / "runs" / "a.db", "write")


def as_nobody(act: Callable[[], None]) -> None:
    """Act as somebody who is not root: root may write everywhere."""
    child = os.fork() if os.geteuid() == 0 else None
    if child is None:
        act()
    elif child == 0:
        try:
            os.setgroups([])
            os.setgid(65534)
            os.setuid(65534)
            act()
            os._exit(0)
        except BaseException:
            traceback.print_exc()
            os._exit(1)
    else:
        assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0


@pytest.mark.parametrize(("folder", "file"), [(0o555, 0o444), (0o777, 0o444), (0o555, 0o666)])
def test_a_read_only_store_can_be_read_but_not_written(folder: int, file: int):
    def act() -> None:
        with Store.open(path) as store:
            assert len(store.findings()) == 30
        with pytest.raises(StoreError, match=r"a\.db: cannot be written") as caught:
            Store.open(path, "write")
        assert caught.value.hint == "give a store in a folder that you may write to"

    with tempfile.TemporaryDirectory() as made:  # pytest's own folders are closed to others
        path = Path(made) / "a.db"
        written(path)
        path.chmod(file)
        path.parent.chmod(folder)
        as_nobody(act)
        path.parent.chmod(0o755)


@pytest.mark.parametrize("mode", ["read", "write"])
def test_a_store_of_the_first_released_schema_is_brought_up_to_date(path: Path, mode):
    written(path)
    with closing(sqlite3.connect(path)) as raw, raw:
        raw.execute("ALTER TABLE run DROP COLUMN world")
        raw.execute("ALTER TABLE triage DROP COLUMN witness_width")
        raw.execute("ALTER TABLE triage DROP COLUMN more")
        raw.execute("ALTER TABLE rollout DROP COLUMN recovery")
        raw.execute("ALTER TABLE cause DROP COLUMN tests")
        raw.execute("ALTER TABLE cause DROP COLUMN mechanism")
        raw.execute("ALTER TABLE rollout ADD COLUMN published_success INTEGER NOT NULL DEFAULT 0")
        raw.execute(STEPS[17][-1])  # creates `repeat`
        raw.execute("PRAGMA user_version = 17")
    with Store.open(path, mode) as store:
        assert (len(store.findings()), store.triaged(), store.causes(1)) == (30, [], None)
    with closing(sqlite3.connect(path)) as raw:
        assert raw.execute("PRAGMA user_version").fetchone() == (max(STEPS),)
        assert raw.execute("SELECT DISTINCT world FROM run").fetchall() == [("{}",)]
        columns = "SELECT m.name, c.name FROM sqlite_master m, pragma_table_info(m.name) c"
        now = set(raw.execute(columns).fetchall())
    with Store.open(path.with_name("new.db"), "write"), closing(sqlite3.connect(path.with_name("new.db"))) as raw:
        assert now == set(raw.execute(columns).fetchall())


def test_a_step_that_breaks_changes_nothing(path: Path, monkeypatch: pytest.MonkeyPatch):
    written(path)
    breaks = ("DROP TABLE finding", "DROP TABLE missing")
    monkeypatch.setattr("vlafuzz.store.migrations.STEPS", STEPS | {max(STEPS) + 1: breaks})
    with pytest.raises(StoreError, match="no such table: missing"):
        Store.open(path, "write")
    monkeypatch.undo()
    with Store.open(path, "write") as store:
        assert len(store.findings()) == 30
