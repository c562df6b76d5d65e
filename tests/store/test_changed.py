"""Stores that somebody else changed: a sentence that names the store, whatever was done to it."""

import sqlite3
import zlib
from contextlib import closing
from pathlib import Path

import pytest

from tests.common.test_reading import in_little_memory
from tests.doubles import failed, stored, trial
from tests.report.stores import store as triaged_store
from vlafuzz.errors import StoreError
from vlafuzz.store.store import Store


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("original") / "a.db"
    return triaged_store(path, findings=1).read_bytes()


def changed(path: Path, original: bytes, *statements: str) -> Path:
    path.write_bytes(original)
    with closing(sqlite3.connect(path)) as raw:
        raw.executescript(f"PRAGMA ignore_check_constraints = ON; {'; '.join(statements)}")
    return path


def read_all(path: Path) -> None:
    with Store.open(path) as store:
        for run in store.runs():
            list(store.trials(run.id)), store.outcomes_by_scene(run.id), store.causes(run.id), store.findings(run.id)
        store.triaged()


@pytest.mark.parametrize(
    ("statement", "says"),
    [
        ("UPDATE run SET packs = '3'", "is damaged: packs: input should be a valid array, got 3"),
        ("UPDATE run SET scene_file = '{}'", "is damaged: scene_file: flag: field required"),
        ("UPDATE run SET place = '[[[['", "is damaged: place: invalid JSON"),
        ("UPDATE run SET spec = 'x'", "is damaged: spec: invalid JSON"),
        ("UPDATE run SET versions = '[]'", "is damaged: input should be an object"),
        ("UPDATE run SET criteria = 'lax'", "is damaged: unknown criteria 'lax'"),
        ("UPDATE run SET seed = -1", "is damaged: seed is -1"),
        ("UPDATE rollout SET reached = '{'", "is damaged: invalid JSON"),
        ("UPDATE rollout SET trace = x'00'", "is damaged: a trace or its actions"),
        ("UPDATE scene SET json = '{}'", "is damaged: task: field required"),
        ("UPDATE scene SET json = replace(json, 'panda', 'other')", "the scene .* is another one"),
        ("UPDATE scene SET json = CAST(x'ff' AS TEXT)", "is damaged"),
        ('UPDATE triage SET rate = \'{"failures":9,"rollouts":3,"low":0,"high":1}\'', "9 failures in 3"),
        ("UPDATE triage SET failures = 9, repeats = 3", "is damaged: 9 failures in 3 repeats"),
        ('UPDATE triage SET operators = \'["light","light"]\'', "operator 'light' is named 2 times"),
        ("UPDATE triage SET necessary = '[\"two lights\"]'", "'two lights' is no name of an operator"),
        ('UPDATE triage SET counterparts = \'{"light":"0"}\'', "is damaged: counterparts.light: there is no scene 0"),
        ("UPDATE triage SET witness_solver = 'somebody'", "is damaged: input should be 'expert' or 'seeing'"),
        ("UPDATE finding SET run = 99", "is damaged: a reference leads nowhere"),
        ("DROP TABLE finding", "is damaged: no such table"),
        ("ALTER TABLE trial DROP COLUMN verdict", "is damaged"),
        ("PRAGMA user_version = 18", "is damaged: duplicate column name"),
        ("PRAGMA user_version = -1", "is damaged"),
    ],
)
def test_it_is_a_sentence(original: bytes, tmp_path: Path, statement: str, says: str):
    path = changed(tmp_path / "a.db", original, statement)
    with pytest.raises(StoreError, match=says) as caught:
        read_all(path)
    assert str(path) in caught.value.message


def test_a_trace_that_unfolds_to_gigabytes_is_refused(tmp_path: Path):
    path = stored(tmp_path / "a.db", trial(0, failed()))
    packer = zlib.compressobj()
    first, again = (packer.compress(bytes(1 << 20)) + packer.flush(zlib.Z_FULL_FLUSH) for _ in range(2))
    bomb = first + 1500 * again  # every block stands for itself
    with closing(sqlite3.connect(path)) as raw, raw:
        raw.execute("UPDATE rollout SET trace = ?", (bomb,))
    with in_little_memory(), pytest.raises(StoreError, match="a trace or its actions: it has more"):
        read_all(path)


def test_a_value_of_more_than_64_mib_is_refused(original: bytes, tmp_path: Path):
    path = changed(tmp_path / "a.db", original, "UPDATE run SET command = hex(zeroblob(35000000))")
    with pytest.raises(StoreError, match="a value has more than 64 MiB"):
        read_all(path)


@pytest.mark.parametrize("place", [0.1, 0.3, 0.5, 0.7, 0.9])
def test_flipped_bytes_are_a_sentence_or_nothing(original: bytes, tmp_path: Path, place: float):
    data = bytearray(original)
    at = int(len(data) * place)
    data[at : at + 40] = bytes(byte ^ 0x5A for byte in data[at : at + 40])
    (tmp_path / "a.db").write_bytes(data)
    try:
        read_all(tmp_path / "a.db")
    except StoreError as error:
        assert "a.db" in error.message  # noqa: PT017 - either is right
