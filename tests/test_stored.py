"""A store as rows and data frames."""

import sys
from dataclasses import replace
from pathlib import Path

import pytest

import vlafuzz
from tests.doubles import begun, ended
from tests.failures.triage.planted import TILTED, Planted
from tests.report.stores import MANIFEST, store
from vlafuzz.errors import PrerequisiteError, StoreError
from vlafuzz.store.records import Attribution
from vlafuzz.store.store import Store


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory):
    return vlafuzz.open_store(store(tmp_path_factory.mktemp("stored") / "a.db", triaged=3))


def test_findings_say_what_triage_knows(results):
    triaged = [finding for finding in results.findings() if finding.evidence == "minimal"]
    assert [len(results.findings()), len(results.findings(2)), len(triaged)] == [6, 3, 3]
    first = triaged[0]
    assert first.conditions[0].startswith(f"{first.operators[0]}: ")
    assert first.rate.failures == first.rate.rollouts > 0
    assert (first.policy, first.task, first.witness) == ("idle", "pick-up", "seeing")
    assert first.replay.startswith("vlafuzz replay ")


def test_runs_and_trials_are_counted(results):
    assert [(run.run, run.failed, run.judged, run.seconds) for run in results.runs()] == [(1, 3, 4, 12), (2, 3, 4, 12)]
    assert [trial.verdict for trial in results.trials(1)] == ["failed", "failed", "failed", "passed"]
    assert len(results.trials()) == 8
    assert results.trials(2)[0].severities["light"] > results.trials(2)[3].severities["light"] == 0


def test_trials_tell_their_values_and_which_scenes_were_drawn_at_random(tmp_path: Path):
    yawed = Planted([TILTED]).finding(0)
    with Store.open(tmp_path / "a.db", "write") as opened:
        for strategy in ("causes", "random"):
            about = replace(MANIFEST, strategy=strategy, label="step-2")
            begun(opened, ended(yawed), ended(yawed, proposal=1), about=about)
        opened.keep_causes(1, Attribution((), at_random=(1,)))
    trials = vlafuzz.open_store(tmp_path / "a.db").trials()
    assert [trial.random for trial in trials] == [False, True, True, True]
    assert (trials[0].task, trials[0].policy, trials[0].label) == ("pick-up", "idle", "step-2")
    assert trials[0].values["camera-orientation.yaw"] == yawed.camera.yaw > 0
    assert trials[0].values["target-position.0.x"] == yawed.targets[0].x


def test_a_data_frame_has_a_column_for_each_inner_value(results):
    pandas = pytest.importorskip("pandas")
    frame = results.findings().to_dataframe()
    assert isinstance(frame, pandas.DataFrame)
    assert {"scene", "operators", "rate_failures", "rate_low"} <= set(frame.columns)
    assert frame["rate_low"].notna().sum() == 3
    assert results.trials().to_dataframe().groupby("run")["severities_light"].max()[2] > 0.2
    assert results.causes().to_dataframe().empty


def test_without_pandas_it_says_what_to_install(results, monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(PrerequisiteError, match="needs pandas") as raised:
        results.runs().to_dataframe()
    assert "-m pip install 'pandas" in raised.value.hint


def test_a_missing_store_or_run_is_named(results, tmp_path: Path):
    with pytest.raises(StoreError, match="no such store"):
        vlafuzz.open_store(tmp_path / "none.db")
    for read in (results.findings, results.trials, results.causes):
        with pytest.raises(StoreError, match="no run 9"):
            read(9)


def test_it_lists_what_it_has():
    assert {"fuzz", "open_store", "regress", "bisect"} <= set(dir(vlafuzz))
    with pytest.raises(AttributeError, match="has no attribute 'fuz'"):
        vlafuzz.fuz  # noqa: B018
