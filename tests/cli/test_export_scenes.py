"""``vlafuzz export`` of the scenes of a store, and of files of VLATest."""

import json
from pathlib import Path
from shutil import copy

import pytest

from tests.cli.typed import IDLE, complaint, typed
from tests.doubles import ClosedForm
from vlafuzz.campaign import config
from vlafuzz.cli import main
from vlafuzz.model.scene_lines import load_scenes

pytestmark = pytest.mark.usefixtures("folder")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store of two runs."""
    path = tmp_path_factory.mktemp("made") / "a.db"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(config, "make_evaluator", lambda manifest, _: ClosedForm(manifest.repeats))
        for seed in ("0", "1"):
            main(["run", *IDLE, "--strategy", "random", "--budget", "20", "--store", str(path), "--seed", seed])
    return path


@pytest.fixture
def store(made: Path, folder: Path, capsys) -> str:
    copy(made, folder / "a.db")
    capsys.readouterr()
    return "a.db"


def test_export_writes_the_failing_scenes_once_each(folder: Path, store: str):
    assert main(["export", store, "--out", "out.jsonl"]) == 0
    scenes = load_scenes(folder / "out.jsonl")
    assert len(set(scenes)) == len(scenes) > 0
    assert all(row.light.intensity < 0.5 for row in scenes)


def test_export_of_one_run_is_a_part_of_all(folder: Path, store: str):
    main(["export", store, "--out", "all.jsonl"])
    main(["export", store, "--out", "one.jsonl", "--run", "2"])
    everything, one = set(load_scenes(folder / "all.jsonl")), set(load_scenes(folder / "one.jsonl"))
    assert one < everything


def test_exported_scenes_are_run_again_and_picked_ones_have_no_failure_rate(store: str, capsys):
    main(["export", store, "--out", "out.jsonl"])
    capsys.readouterr()
    again = ["--scenes", "out.jsonl", "--budget", "2", "--store", "b.db"]
    shown = " ".join(typed(capsys, ["run", *IDLE, *again]).out.split())
    assert "how often it fails is unknown without random scenes" in shown
    assert "interval" not in shown


def test_scenes_are_read_from_a_file_with_verdicts_as_earlier_versions_wrote_it(store: str):
    main(["export", store, "--out", "one.jsonl"])
    lines = Path("one.jsonl").read_text().splitlines()
    Path("two.jsonl").write_text("\n".join(f'{line[:-1]},"verdict":"failed"}}' for line in lines))
    assert load_scenes(Path("two.jsonl")) == load_scenes(Path("one.jsonl"))


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["no.db", "--out", "out.jsonl"], "no.db: no such store"),
        (["a.db", "--out", "out.jsonl", "--run", "9"], "a.db: no run 9"),
        (["a.db", "--out", "a.db/out.jsonl"], "cannot be written"),
    ],
)
def test_export_refuses_what_is_not_there(store: str, capsys, arguments: list[str], says: str):
    assert says in complaint(capsys, ["export", *arguments])


UPRIGHT = [0.7071067811865476, 0.7071067811865475, 0.0, 0.0]


def scene_file(folder: Path, *models: str) -> Path:
    options = {"init_xy": [-0.31, 0.17], "orientation": UPRIGHT}
    result = {str(i): {"model_id": model, "obj_init_options": options} for i, model in enumerate(models)}
    path = folder / f"t-grasp_{len(models)}.json"
    path.write_text(json.dumps(result | {"seed": 7, "num": len(models)}))
    return path


def test_several_files_become_one_in_order(tmp_path: Path, capsys):
    out = tmp_path / "scenes.jsonl"
    files = [scene_file(tmp_path, "apple", "hammer"), scene_file(tmp_path, "opened_pepsi_can")]
    assert main(["export", *map(str, files), "--out", str(out)]) == 0
    objects = [(scene.robot, scene.targets[0].object) for scene in load_scenes(out)]
    assert objects == [("google", f"custom:{name}") for name in ("apple", "hammer", "opened_pepsi_can")]
    assert "3 scenes written to" in capsys.readouterr().err


def test_nowhere_to_write_and_another_file_are_usage_errors(folder: Path, capsys):
    file = scene_file(folder, "apple")
    said = typed(capsys, ["export", str(file), "--out", "no/x.jsonl"], code=2).err
    assert said.startswith("error: --out: cannot write")
    (folder / "x.json").write_text("[]")
    assert "not a scene file of VLATest" in typed(capsys, "export x.json --out x.jsonl", code=2).err
