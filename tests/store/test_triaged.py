import json
import sqlite3
from contextlib import closing
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
import pytest

from tests.doubles import failed, manifest, scene, trial
from vlafuzz.model.evidence import Causes, Rate, Threshold, Witness
from vlafuzz.store import rows
from vlafuzz.store.merge import merge
from vlafuzz.store.records import Triaged
from vlafuzz.store.store import Store

KEY = manifest().key()
WITNESS = Witness(np.random.default_rng(0).normal(size=(9, 7)).astype(np.float32), "a" * 32, 1, "seeing")
DIM = (("light.intensity", 0.5),)
THRESHOLD = Threshold("light", DIM, 0.25, low=DIM, high=DIM, direction="dark", ranges=((DIM, DIM), (DIM, ())))
MINIMAL = Triaged(
    scene=trial(0, failed()).scene,
    policy_key=KEY,
    bucket="minimal",
    repeats=1,
    failures=1,
    deviating=("confounders", "light"),
    shrunk=scene(light=0.5),
    lost_stage="grasp",
    operators=("light",),
    causes=Causes(("light",), ("light",), (THRESHOLD,)),
    counterparts={"light": scene()},
    signature="pick-up|grasp|light:dark",
    witness=WITNESS,
    shrink_rollouts=17,
    policy_rollouts=18,
    expert_rollouts=2,
    seconds=1.5,
)
FLAKY = Triaged(
    scene=MINIMAL.scene, policy_key=KEY, bucket="flaky", repeats=5, failures=1, deviating=("light",), detail="1 of 5"
)


def store(path: Path, triaged: Triaged | None = None) -> Path:
    with Store.open(path, "write") as opened:
        run = opened.begin(manifest())
        for proposal in range(2):
            opened.add(run, trial(proposal, failed()))
        if triaged:
            opened.settle(triaged)
    return path


def read(path: Path) -> list[Triaged]:
    with Store.open(path) as store:
        return store.triaged()


@pytest.mark.parametrize("kept", [MINIMAL, FLAKY], ids=lambda kept: kept.bucket)
def test_what_triage_made_of_a_finding_comes_back(tmp_path: Path, kept: Triaged):
    (got,) = read(store(tmp_path / "a.db", kept))
    plain = [field.name for field in fields(Triaged) if field.name != "witness"]
    assert {name: getattr(got, name) for name in plain} == {name: getattr(kept, name) for name in plain}
    assert (got.witness is None) == (kept.witness is None)
    if got.witness and kept.witness:
        assert got.witness.actions.tobytes() == kept.witness.actions.tobytes()
        assert (got.witness.states_hash, got.witness.attempt) == ("a" * 32, 1)


def test_a_level_of_evidence_needs_no_column_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    @dataclass(frozen=True, eq=False, kw_only=True)
    class Deeper(Triaged):
        elsewhere: Rate | None = None
        hints: tuple[str, ...] = ()

    made = Deeper(**vars(FLAKY), elsewhere=Rate.of_counts(2, 3), hints=("a", "b"))
    monkeypatch.setattr(rows, "Triaged", Deeper)
    earlier = store(tmp_path / "earlier.db", FLAKY)
    monkeypatch.setattr(rows, "_MORE", rows.without_column(Deeper))
    for path, known in ((store(tmp_path / "a.db", made), (made.elsewhere, made.hints)), (earlier, (None, ()))):
        (got,) = read(path)
        assert (got.elsewhere, got.hints) == known


def test_a_threshold_of_an_earlier_version_has_no_interval(tmp_path: Path):
    path = store(tmp_path / "a.db", MINIMAL)
    older = json.dumps([{"operator": "light", "at": [["light.intensity", 0.5]], "share": 0.25}])
    with closing(sqlite3.connect(path)) as connection, connection:
        connection.execute("UPDATE triage SET thresholds = ?", [older])
    (got,) = read(path)
    assert got.causes.thresholds == (Threshold("light", DIM, 0.25),)


def test_triaging_a_finding_again_replaces_what_was_made_of_it(tmp_path: Path):
    path = store(tmp_path / "a.db", MINIMAL)
    with Store.open(path, "write") as opened:
        opened.settle(FLAKY)
    assert [triaged.bucket for triaged in read(path)] == ["flaky"]


@pytest.mark.parametrize("first", [0, 1])
def test_of_two_stores_that_triaged_a_finding_the_better_evidence_is_kept(tmp_path: Path, first: int):
    stores = [store(tmp_path / "a.db", MINIMAL), store(tmp_path / "b.db", FLAKY)]
    merge([stores[first], stores[1 - first]], tmp_path / "out.db")
    (got,) = read(tmp_path / "out.db")
    assert (got.bucket, got.shrunk, got.shrink_rollouts) == ("minimal", MINIMAL.shrunk, 17)


def test_a_bucket_that_is_none_is_refused(tmp_path: Path):
    with pytest.raises(Exception, match="CHECK constraint failed"):
        store(tmp_path / "a.db", replace(FLAKY, bucket="great"))


def test_what_failed_at_nominal_in_an_earlier_version_is_not_shown_to_have_a_cause(tmp_path: Path):
    path = store(tmp_path / "a.db", MINIMAL)
    with closing(sqlite3.connect(path)) as connection, connection:
        connection.execute("UPDATE triage SET bucket = 'base'")
        connection.execute("ALTER TABLE rollout ADD COLUMN published_success INTEGER NOT NULL DEFAULT 0")
        connection.execute("ALTER TABLE triage DROP COLUMN more")
        connection.execute("PRAGMA user_version = 21")
    (got,) = read(path)
    assert (got.bucket, got.shrunk, got.signature) == ("flaky", None, None)
