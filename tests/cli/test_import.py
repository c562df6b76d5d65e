import json
from pathlib import Path

from vlafuzz.cli import main
from vlafuzz.model.scene_lines import load_scenes

UPRIGHT = [0.7071067811865476, 0.7071067811865475, 0.0, 0.0]


def scene_file(folder: Path, *models: str) -> Path:
    options = {"init_xy": [-0.31, 0.17], "orientation": UPRIGHT}
    result = {str(i): {"model_id": model, "obj_init_options": options} for i, model in enumerate(models)}
    path = folder / f"t-grasp_{len(models)}.json"
    path.write_text(json.dumps(result | {"seed": 7, "num": len(models)}))
    return path


def test_several_files_become_one_in_order(tmp_path: Path, capsys):
    out = tmp_path / "scenes.jsonl"
    files = [scene_file(tmp_path, "apple", "hammer", "orange"), scene_file(tmp_path, "sponge")]
    assert main(["export", *map(str, files), "--out", str(out), "--json"]) == 0
    assert [scene.targets[0].object for scene in load_scenes(out)] == ["apple", "orange", "sponge"]
    message = capsys.readouterr()
    rows = json.loads(message.out)
    assert [(row["scenes"], row["written"], row["left out"]) for row in rows] == [(3, 2, 1), (1, 1, 0)]
    assert [row["missing"] for row in rows] == [{"hammer": 1}, {}]
    assert "hammer" in message.err
    assert "1 scenes are left out" in message.err


def test_nowhere_to_write(tmp_path: Path, capsys):
    file = scene_file(tmp_path, "apple")
    assert main(["export", str(file), "--out", str(tmp_path / "no" / "x.jsonl")]) == 2
    assert capsys.readouterr().err.startswith("error: --out: cannot write")


def test_another_file_is_a_usage_error(tmp_path: Path, capsys):
    path = tmp_path / "x.json"
    path.write_text("[]")
    assert main(["export", str(path), "--out", str(tmp_path / "x.jsonl")]) == 2
    assert "not a scene file of VLATest" in capsys.readouterr().err


def test_the_original_frame_leaves_nothing_out(tmp_path: Path, capsys):
    out = tmp_path / "scenes.jsonl"
    file = scene_file(tmp_path, "hammer", "opened_pepsi_can")
    assert main(["export", str(file), "--out", str(out), "--frame", "original"]) == 0
    assert [(scene.robot, scene.targets[0].object) for scene in load_scenes(out)] == [
        ("google", "custom:hammer"),
        ("google", "custom:opened_pepsi_can"),
    ]
    assert capsys.readouterr().err == ""


def test_scenes_that_an_export_would_move_are_noted(tmp_path: Path, capsys):
    kept, back = tmp_path / "kept.jsonl", tmp_path / "back.json"
    assert main(["export", str(scene_file(tmp_path, "apple")), "--out", str(kept), "--frame", "keep"]) == 0
    assert "would move these scenes" in capsys.readouterr().err
    assert main(["export", str(kept), "--format", "vlatest", "--out", str(back)]) == 0
    assert "note: positions are stretched from our box onto VLATest's" in capsys.readouterr().err
