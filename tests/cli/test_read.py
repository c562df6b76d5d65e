"""``vlafuzz read``: what it prints, what it writes, and how it ends."""

from pathlib import Path

import pytest

from tests.cli.typed import told, typed
from tests.logs.samples import suite_csv


@pytest.fixture(autouse=True)
def logs(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    suite_csv(Path("old.csv"), goal="s" * 18 + "ff", long="s" * 10)
    suite_csv(Path("worse.csv"), goal="f" * 18 + "ff", long="s" * 9 + "e")
    suite_csv(Path("few.csv"), goal="sf")


def test_a_log_alone_is_fine_whatever_it_says(capsys):
    shown = typed(capsys, ["read", "worse.csv"]).out
    assert "0% (0–16.1%)" in shown


@pytest.mark.parametrize(
    ("log", "code", "verdict"),
    [
        ("old.csv", 0, "old.csv is not shown to differ from old.csv"),
        ("worse.csv", 1, "worse.csv is worse than old.csv in goal, all, not shown to differ in long"),
        ("few.csv", 3, "cannot tell: too few episodes succeed in old.csv"),
    ],
)
def test_the_exit_code_says_whether_it_got_worse(log, code, verdict, capsys):
    assert verdict in " ".join(typed(capsys, f"read {log} --against old.csv", code=code).out.split())


def test_json_has_the_figures_and_the_verdict(capsys):
    document = told(capsys, ["read", "worse.csv", "--against", "old.csv", "--json"], code=1)
    rate = document["rates"][1]
    assert (rate["suite"], rate["errors"]) == ("goal", 0)
    assert rate["success"] == {"count": 0, "of": 20, "low": 0, "high": pytest.approx(0.1611, abs=1e-4)}
    assert document["against"]["worse"] == ["goal", "all"]
    assert document["against"]["contrasts"][0]["worse"] == 18


@pytest.mark.parametrize(
    ("words", "message"),
    [(["--alpha", "1"], "expected a probability"), (["--against", "none.csv"], "none.csv: cannot be read")],
)
def test_a_wrong_flag_is_one_sentence(words, message, capsys):
    assert message in typed(capsys, ["read", "old.csv", *words], code=2).err
