"""Flags that would have no effect are refused with a sentence, before anything is run."""

from pathlib import Path

import pytest

from tests.cli.typed import typed
from tests.doubles import manifest
from tests.worlds.tabletop.sim.scenes import nominal
from vlafuzz.cli import main
from vlafuzz.model.scene_lines import write_scenes
from vlafuzz.store.store import Store


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    write_scenes(Path("s.jsonl"), [nominal("pick-up")])
    with Store.open(Path("a.db"), "write") as store:
        store.begin(manifest())


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ("run --policy frozen --scenes s.jsonl --vary light", "--vary light: the scenes of --scenes are run"),
        ("report a.db --out a.html --limit 3 --no-videos", "--limit 3: with --no-videos there are none"),
    ],
)
def test_a_flag_without_effect_is_refused(arguments: str, says: str, capsys):
    said = typed(capsys, arguments.split(), code=2).err
    assert says in said
    assert "\nhint: " in said


def test_repeats_of_a_deterministic_policy_are_noted(capsys):
    flags = ["--strategy", "random", "--budget", "2", "--config", "repeats=2", "--no-certify"]
    assert main(["run", "--policy", "frozen", *flags, "--store", "b.db"]) == 0
    assert "note: frozen is deterministic: repeats differ only" in capsys.readouterr().err
