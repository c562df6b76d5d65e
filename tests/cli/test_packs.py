"""--pack, and what becomes of a run whose pack is gone."""

import json
import shutil
import sqlite3
from pathlib import Path

import pytest

from tests.cli.typed import told, typed
from tests.packs import box, write_pack
from vlafuzz.cli import main
from vlafuzz.model import Placement, Scene
from vlafuzz.model.scene_lines import write_scenes
from vlafuzz.store.store import Store


@pytest.fixture
def folder(tmp_path: Path, monkeypatch) -> Path:
    monkeypatch.setenv("VLAFUZZ_PACKS", "")
    sticks = {f"opened_{colour}_stick": box(0.03, 0.04, 0.08) for colour in ("red", "blue", "green", "grey")}
    return write_pack(tmp_path / "mine", **sticks)


def test_objects_lists_a_packs_own(folder, capsys):
    rows = json.loads(typed(capsys, ["list", "objects", "--pack", str(folder), "--json"]).out)
    sticks = [f"mine:opened_{colour}_stick" for colour in ("blue", "green", "grey", "red")]
    assert [row["object"] for row in rows] == sticks
    assert (rows[0]["spoken"], rows[0]["size"]) == ("blue stick", [0.03, 0.04, 0.08])


def test_lint_knows_a_packs_objects_when_it_is_given(folder, tmp_path, capsys):
    file = tmp_path / "scenes.jsonl"
    stick = Placement("mine:opened_red_stick", "upright", 0.0, 0.0)
    write_scenes(file, [Scene("pick-up", (stick,), "pick up red stick")])
    assert "unknown object 'mine:opened_red_stick'" in typed(capsys, ["lint", "--static", str(file)], code=1).out
    assert main(["lint", str(file), "--pack", str(folder)]) == 0


def run(folder: Path, policy: str = "expert", *more: str) -> Path:
    store = folder.parent / "a.db"
    given = ["--pack", str(folder), "--policy", policy, "--strategy", "random", "--budget", "4"]
    assert main(["run", *given, "--config", "stop-early=true", "--store", str(store), "--json", *more]) == 0
    return store


def test_a_run_is_made_of_the_packs_objects_and_the_expert_can_take_them(folder, capsys):
    run(folder)
    summary = json.loads(capsys.readouterr().out)
    assert summary["verdicts"]["passed"] == summary["rollouts"] == 4


def test_the_pinhole_knows_a_packs_objects(folder, capsys):
    run(folder, "pinhole", "--vary", "target-type,target-position")
    assert json.loads(capsys.readouterr().out)["verdicts"]["passed"] >= 3


def test_replay_finds_the_pack_again_and_says_so_when_it_is_gone(folder, capsys, monkeypatch):
    store = run(folder, "frozen")
    capsys.readouterr()
    assert told(capsys, ["replay", str(store), "--json"])["same trajectory as stored"] is True
    monkeypatch.setenv("VLAFUZZ_PACKS", "")
    moved = shutil.move(folder, folder.parent / "moved")
    for command in (["replay"], ["triage"], ["report", "--out", "never.html"]):
        assert "it needs the pack 'mine'" in typed(capsys, [*command, str(store)], code=2).err
    assert told(capsys, ["replay", str(store), "--json", "--pack", str(moved)])["same trajectory as stored"] is True
    monkeypatch.setenv("VLAFUZZ_PACKS", str(moved))
    assert told(capsys, ["replay", str(store), "--json"])["same trajectory as stored"] is True


def test_a_run_that_ended_early_goes_on_with_its_pack(folder, capsys):
    store = run(folder)
    raw = sqlite3.connect(store)
    raw.execute("UPDATE run SET budget = 6, status = 'interrupted'")
    raw.commit()
    raw.close()
    capsys.readouterr()
    assert told(capsys, ["run", "--resume", "--store", str(store), "--json"])["rollouts"] == 6
    with Store.open(store) as opened:
        assert {trial.scene.targets[0].object.partition(":")[0] for trial in opened.trials(1)} == {"mine"}
