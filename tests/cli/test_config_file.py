"""Flags from a YAML file."""

import json
from pathlib import Path

import pytest

from tests.cli.typed import complaint, told, typed


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(capsys, *flags: str) -> dict:
    return told(capsys, ["run", "--config", "run.yaml", "--json", *flags])


def test_a_file_says_how_to_run_and_the_command_line_wins(folder, capsys):
    (folder / "run.yaml").write_text(
        "policy: frozen\nstrategy: random\nbudget: 2\nstop-early: true\nvary: [light, target-position]\n"
    )
    done = run(capsys, "--store", "a.db")
    assert (done["policy"], done["strategy"], done["rollouts"]) == ("frozen", "random", 2)
    assert run(capsys, "--budget", "1", "--store", "b.db")["rollouts"] == 1


def test_options_are_also_given_one_by_one_and_the_last_one_counts(folder, capsys):
    (folder / "run.yaml").write_text("policy: frozen\nstrategy: random\nbudget: 2\nrepeats: 1\n")
    printed = typed(capsys, "run --config run.yaml --config repeats=2 --store a.db --json")
    done = json.loads(printed.out)
    assert (done["rollouts"], done["proposals"]) == (2, 1)
    assert "note: frozen is deterministic: repeats differ only" in printed.err
    assert "'repaets' is no flag of this command" in typed(capsys, "run --config repaets=2", code=2).err


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("bugdet: 3", "'bugdet' is no flag of this command"),
        ("- budget", "not a list of flags"),
        ("budget: {a: 1}", "budget: not a value of a flag"),
        ("trust: true", "'trust' is no flag of this command"),
        ("policy: python:tests.doubles:make_idle", "which is not run just because a file names it"),
        ("budget: [", "YAML"),
        ("budget: many", "--budget"),
    ],
)
def test_a_wrong_file_is_refused_in_a_sentence(folder, capsys, text, says):
    (folder / "run.yaml").write_text(text + "\n")
    assert says in complaint(capsys, "run --config run.yaml")
