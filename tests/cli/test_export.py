import json
from pathlib import Path

import pytest

from tests.cli.typed import complaint, typed
from tests.doubles import manifest, stored
from tests.failures.corpus.test_export import CheckingRunner
from tests.failures.triage.planted import TILTED
from vlafuzz.cli import main
from vlafuzz.failures.corpus.folder import read_corpus
from vlafuzz.model import Scene
from vlafuzz.model.scene_lines import load_scenes
from vlafuzz.rollouts import scene_runner as runner
from vlafuzz.store.store import Store


@pytest.fixture(autouse=True)
def store(tilted: Path, monkeypatch) -> Path:
    """The findings are triaged; there is no simulator."""
    monkeypatch.setattr(runner, "SimulatorSceneRunner", lambda store, run, **_: CheckingRunner([TILTED]))
    assert main(["triage", "a.db"]) == 0
    return tilted


def test_minimal_failures_become_a_folder_that_reads_back(capsys):
    said = typed(capsys, "export a.db --minimal --controls 30 --out tilted").err
    made = read_corpus(Path("tilted"))
    assert (made.name, len(made.controls)) == ("tilted", 30)
    assert f"{len(made.cases)} minimal failures (1 cause) and 30 controls written to tilted" in said
    assert load_scenes(Path("tilted/scenes.jsonl")) == [case.scene for case in made.cases]
    manifest = json.loads(Path("tilted/manifest.json").read_text())
    assert manifest["evidence"]["left_out"] == {}


def test_a_task_without_a_minimal_failure_is_said_to_have_no_corpus(capsys):
    stored(Path("a.db"), about=manifest(task="put-on"))
    said = typed(capsys, "export a.db --minimal --controls 30 --out tilted").err
    assert "no corpus of put-on: no minimal finding" in said


def test_what_no_longer_holds_is_said(monkeypatch, capsys):
    with Store.open(Path("a.db")) as opened:
        kept = opened.triaged()[0].shrunk

    def fails(scene: Scene) -> bool:
        near = abs(scene.camera.yaw - kept.camera.yaw) < 0.1
        return near and scene.targets[0].object == kept.targets[0].object

    monkeypatch.setattr(runner, "SimulatorSceneRunner", lambda store, run, **_: CheckingRunner([fails]))
    assert "left out: " in typed(capsys, "export a.db --minimal --out tilted").err
    assert len(read_corpus(Path("tilted")).cases) == 1


@pytest.mark.parametrize(
    ("flags", "says"),
    [
        (["--minimal", "--out", "a.db"], "a.db: exists already"),
        (["--minimal", "--format", "lerobot", "--out", "b"], "--minimal does not go with --format"),
        (["--controls", "9", "--out", "b"], "--controls 9: only a corpus has controls"),
        (["--minimal", "--controls", "-1", "--out", "b"], "--controls: expected at least 0, got -1"),
        (["--minimal", "--out", "a.db/b"], "a.db/b: cannot be written: not a directory"),
    ],
)
def test_bad_flags_are_one_sentence_with_a_hint(flags, says: str, capsys):
    before = sorted(Path().iterdir())
    assert says in complaint(capsys, ["export", "a.db", *flags])
    assert sorted(Path().iterdir()) == before


def test_a_store_without_failures_has_no_demonstrations(capsys):
    pytest.importorskip("pyarrow")
    stored(Path("b.db"))
    assert "b.db: has no failing scene" in typed(capsys, "export b.db --format lerobot --out shown", code=2).err
    assert not Path("shown").exists()
