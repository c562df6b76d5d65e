"""``vlafuzz read``: what it prints, what it writes, and how it ends."""

from pathlib import Path

import pytest

from tests.cli.typed import told, typed
from tests.logs.samples import suite_csv


@pytest.fixture(autouse=True)
def logs(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    suite_csv(Path("worse.csv"), goal="f" * 18 + "ff", long="s" * 9 + "e")


def test_a_log_alone_is_fine_whatever_it_says(capsys):
    shown = typed(capsys, ["read", "worse.csv"]).out
    assert "0% (0–16.1%)" in shown


def test_json_has_the_figures(capsys):
    rate = told(capsys, ["read", "worse.csv", "--json"])["rates"][1]
    assert (rate["suite"], rate["errors"]) == ("goal", 0)
    assert rate["success"] == {"count": 0, "of": 20, "low": 0, "high": pytest.approx(0.1611, abs=1e-4)}


def test_a_log_that_is_missing_is_one_sentence(capsys):
    assert "none.csv: cannot be read" in typed(capsys, ["read", "none.csv"], code=2).err
