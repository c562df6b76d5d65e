"""The failures that ``vlafuzz report`` lists in the terminal."""

import json
import re
from dataclasses import asdict

import pytest

from tests.cli.typed import told, typed
from tests.report.stores import store as made_up
from vlafuzz.api import open_store


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    path = tmp_path_factory.mktemp("findings") / "a.db"
    made_up(path, triaged=3)
    return path


def test_each_finding_has_its_cause_evidence_and_id(store, capsys):
    found = told(capsys, ["report", str(store), "--json"])
    minimal = [one for one in found if one["evidence"] == "minimal"]
    assert minimal
    assert found[: len(minimal)] == minimal  # the most evidence first
    assert all(one["operators"] and one["signature"] and "rollouts" in one["detail"] for one in minimal)
    shown = typed(capsys, ["report", str(store)]).out
    assert minimal[0]["scene"][:12] in shown
    assert f"see number 1: vlafuzz replay {store} {minimal[0]['scene'][:12]}" in shown


def test_json_is_the_rows_of_python(store, capsys):
    printed = {row["found"]: row for row in told(capsys, ["report", str(store), "--json"])}
    rows = open_store(store).findings()
    assert printed == {row.found: json.loads(json.dumps(asdict(row))) for row in rows}
    assert any(row["necessary"] and row["rate"] for row in printed.values())


def test_a_limit_says_how_many_are_left_out_and_what_to_do_next(store, capsys):
    number = len(told(capsys, ["report", str(store), "--json"]))
    shown = typed(capsys, ["report", str(store), "--limit", "1"]).out
    assert f"{number - 1} more: --limit 0 shows all of them" in shown
    assert f"vlafuzz triage {store}" in shown


def test_a_corpus_has_findings_too(capsys):
    found = told(capsys, ["report", "mini-pick-up", "--json"])
    assert len(found) >= 20
    assert {one["witness"] for one in found} <= {"expert", "seeing"}
    assert {one["run"] for one in found} == {None}


def test_a_corpus_that_takes_hours_is_said_to(tmp_path, monkeypatch, capsys):
    path = made_up(tmp_path / "a.db")
    monkeypatch.setattr("vlafuzz.failures.corpus.export.pace", lambda *_: 18.0)
    said = typed(capsys, ["report", str(path)]).out
    assert re.search(r"for vlafuzz regress \(about \d+ min; fewer --controls take less\): vlafuzz export", said)
