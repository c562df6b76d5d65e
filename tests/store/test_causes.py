from pathlib import Path

import pytest

from tests.doubles import failed, manifest, trial
from vlafuzz.errors import StoreError
from vlafuzz.model.quantities import Mechanism
from vlafuzz.search.probability import Probability
from vlafuzz.store.merge import merge
from vlafuzz.store.records import Attribution, FoundCause
from vlafuzz.store.store import Store

DARK = FoundCause(trial(0, failed()).scene, ("light",), 7, Probability(0.2, 0.15, 0.25))
CROWDED = FoundCause(trial(1, failed()).scene, ("confounders", "light"), 2)
LOWER = Mechanism("down", 11.0, True, ("camera-orientation -pitch", "target-position +x"))
SHIFTED = FoundCause(trial(1, failed()).scene, ("camera-orientation",), 9, Probability(0.3, 0.2, 0.4), LOWER)
NOT_STORED = FoundCause(None, ("camera-position",), 1)
FOUND = Attribution((DARK, SHIFTED, CROWDED, NOT_STORED), 3, Probability(0.4, 0.3, 0.5))


def store(path: Path, *found: Attribution) -> Path:
    """A store with a run of two failures for each attribution."""
    with Store.open(path, "write") as opened:
        for one in found:
            run = opened.begin(manifest())
            for proposal in range(2):
                opened.add(run, trial(proposal, failed()))
            opened.keep_causes(run, one)
    return path


def read(path: Path, run: int = 1) -> Attribution | None:
    with Store.open(path) as opened:
        return opened.causes(run)


def test_the_causes_of_a_run_come_back_in_order(tmp_path: Path):
    assert read(store(tmp_path / "a.db", FOUND)) == FOUND


def test_they_replace_those_that_were_kept_before(tmp_path: Path):
    with Store.open(store(tmp_path / "a.db", FOUND, FOUND), "write") as opened:
        opened.keep_causes(1, Attribution((CROWDED,)))
    assert read(tmp_path / "a.db", 1) == Attribution((CROWDED,), 0, None)
    assert read(tmp_path / "a.db", 2) == FOUND


def test_a_run_that_found_no_cause_differs_from_one_that_did_not_look(tmp_path: Path):
    with Store.open(store(tmp_path / "a.db", Attribution(())), "write") as opened:
        other = opened.begin(manifest())
        assert (opened.causes(1), opened.causes(other)) == (Attribution(()), None)
        with pytest.raises(StoreError, match="no run 9"):
            opened.causes(9)


def test_merging_keeps_the_causes_of_every_run(tmp_path: Path):
    one = store(tmp_path / "one.db", Attribution((CROWDED,), 1))
    merge([one, store(tmp_path / "other.db", FOUND)], tmp_path / "out.db")
    assert read(tmp_path / "out.db", 1) == Attribution((CROWDED,), 1)
    assert read(tmp_path / "out.db", 2) == FOUND
