"""What a store keeps of findings that are triaged, and of the causes of a run."""

import json
import sqlite3
from contextlib import closing
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
import pytest
from pydantic import TypeAdapter

from tests.doubles import begun, failed, manifest, scene, trial
from vlafuzz.errors import StoreError
from vlafuzz.model import Causes, Mechanism, Rate, Threshold, Witness
from vlafuzz.search.probability import Probability
from vlafuzz.store import rows
from vlafuzz.store.migrations import STEPS
from vlafuzz.store.records import Attribution, FoundCause, Triaged
from vlafuzz.store.store import Store

KEY = manifest().key()
WITNESS = Witness(np.random.default_rng(0).normal(size=(9, 7)).astype(np.float32), "a" * 32, 1, "seeing")
DIM = (("light.intensity", 0.5),)
THRESHOLD = Threshold("light", DIM, 0.25, low=DIM, high=DIM, direction="dark", ranges=((DIM, DIM), (DIM, ())))
FOUND_AS = {"scene": trial(0, failed()).scene, "policy_key": KEY, "repeats": 1, "failures": 1}
CAUSE = {"operators": ("light",), "causes": Causes(("light",), ("light",), (THRESHOLD,)), "lost_stage": "grasp"}
CAUSE |= {"counterparts": {"light": scene()}, "signature": "pick-up|grasp|light:dark", "recovery": 6}
SPENT = {"shrink_rollouts": 17, "policy_rollouts": 18, "expert_rollouts": 2, "seconds": 1.5}
LEFT = {"bucket": "minimal", "deviating": ("confounders", "light"), "shrunk": scene(light=0.5), "witness": WITNESS}
MINIMAL = Triaged(**FOUND_AS, **LEFT, **CAUSE, **SPENT)
FLAKY = Triaged(
    scene=MINIMAL.scene, policy_key=KEY, bucket="flaky", repeats=5, failures=1, deviating=("light",), detail="1 of 5"
)


def store(path: Path, triaged: Triaged | None = None) -> Path:
    with Store.open(path, "write") as opened:
        begun(opened, trial(0, failed()), trial(1, failed()))
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
    earlier = store(tmp_path / "earlier.db", FLAKY)
    monkeypatch.setattr(rows, "_TRIAGED", TypeAdapter(Deeper))
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


def test_a_bucket_that_is_none_is_refused(tmp_path: Path):
    with pytest.raises(Exception, match="CHECK constraint failed"):
        store(tmp_path / "a.db", replace(FLAKY, bucket="great"))


def test_what_failed_at_nominal_in_an_earlier_version_is_not_shown_to_have_a_cause(tmp_path: Path):
    path = store(tmp_path / "a.db", MINIMAL)
    with closing(sqlite3.connect(path)) as connection, connection:
        connection.execute("UPDATE triage SET bucket = 'base'")
        connection.execute("ALTER TABLE rollout ADD COLUMN published_success INTEGER NOT NULL DEFAULT 0")
        connection.execute("ALTER TABLE triage DROP COLUMN more")
        connection.execute("ALTER TABLE rollout DROP COLUMN recovery")
        connection.execute(STEPS[17][-1])  # creates `repeat`
        connection.execute("ALTER TABLE cause DROP COLUMN tests")
        connection.execute("PRAGMA user_version = 21")
    (got,) = read(path)
    assert (got.bucket, got.shrunk, got.signature) == ("flaky", None, None)


DARK = FoundCause(trial(0, failed()).scene, ("light",), 7, Probability(0.2, 0.15, 0.25))
TESTS = {"": (True, True, False), "light": (False,), "confounders": ()}
CROWDED = FoundCause(trial(1, failed()).scene, ("confounders", "light"), 2, tests=TESTS)
LOWER = Mechanism("down", 11.0, True, ("camera-orientation -pitch", "target-position +x"), swapped=True)
SHIFTED = FoundCause(trial(1, failed()).scene, ("camera-orientation",), 9, Probability(0.3, 0.2, 0.4), LOWER)
NOT_STORED = FoundCause(None, ("camera-position",), 1)
FOUND = Attribution((DARK, SHIFTED, CROWDED, NOT_STORED), 3, Probability(0.4, 0.3, 0.5))


def caused(path: Path, *found: Attribution) -> Path:
    """A store with a run of two failures for each attribution."""
    with Store.open(path, "write") as opened:
        for one in found:
            opened.keep_causes(begun(opened, trial(0, failed()), trial(1, failed())), one)
    return path


def read_causes(path: Path, run: int = 1) -> Attribution | None:
    with Store.open(path) as opened:
        return opened.causes(run)


def test_the_causes_of_a_run_come_back_in_order(tmp_path: Path):
    assert read_causes(caused(tmp_path / "a.db", FOUND)) == FOUND


def test_they_replace_those_that_were_kept_before(tmp_path: Path):
    with Store.open(caused(tmp_path / "a.db", FOUND, FOUND), "write") as opened:
        opened.keep_causes(1, Attribution((CROWDED,)))
    assert read_causes(tmp_path / "a.db", 1) == Attribution((CROWDED,), 0, None)
    assert read_causes(tmp_path / "a.db", 2) == FOUND


def test_a_run_that_found_no_cause_differs_from_one_that_did_not_look(tmp_path: Path):
    with Store.open(caused(tmp_path / "a.db", Attribution(())), "write") as opened:
        other = opened.begin(manifest())
        assert (opened.causes(1), opened.causes(other)) == (Attribution(()), None)
        with pytest.raises(StoreError, match="no run 9"):
            opened.causes(9)
