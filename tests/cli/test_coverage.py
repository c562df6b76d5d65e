import csv
import io
import json
from pathlib import Path

import pytest

from tests.cli.typed import told, typed
from tests.doubles import scene
from tests.report.stores import store
from vlafuzz.cli import main
from vlafuzz.model.scene_lines import write_scenes


def scenes(folder: Path) -> Path:
    path = folder / "scenes.jsonl"
    write_scenes(path, [scene(x=-0.2 + 0.03 * number) for number in range(9)])
    return path


def test_a_file_and_a_store_in_one_table(tmp_path: Path, capsys):
    run = store(tmp_path / "a.db", triaged=0)
    rows = told(capsys, ["lab", "coverage", str(scenes(tmp_path)), str(run), "--first", "4", "--json"])
    assert [(row["run"], row["scenes"]) for row in rows] == [(None, 4), (None, 9), (1, 4), (2, 4)]
    assert [row["failures"] is None for row in rows] == [True, True, False, False]


def test_rows_as_csv(tmp_path: Path, capsys):
    assert main(["lab", "coverage", str(scenes(tmp_path)), "--csv"]) == 0
    (row,) = csv.DictReader(io.StringIO(capsys.readouterr().out))
    assert (row["task"], row["scenes"], row["positions"]) == ("pick-up", "9", "0.08")


def test_vlatests_files_stand_beside_the_papers_figures(tmp_path: Path, capsys):
    path = tmp_path / "t-grasp.json"
    upright = [0.7071067811865476, 0.7071067811865475, 0.0, 0.0]
    options = {"init_xy": [-0.31, 0.17], "orientation": upright}
    entries = {str(number): {"model_id": "hammer", "obj_init_options": options} for number in range(10)}
    path.write_text(json.dumps(entries))
    (row,) = told(capsys, ["lab", "coverage", str(path), "--json"])
    assert (row["scenes"], row["positions"], row["published"], row["sites"]) == (10, 0.01, 0.09, None)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["nowhere.jsonl"], "nowhere.jsonl: cannot be read"),
        (["nowhere.db"], "nowhere.db: cannot be read"),
        (["a.jsonl", "--first", "0"], "--first"),
    ],
)
def test_bad_input_is_a_sentence(arguments: list[str], says: str, capsys):
    assert says in typed(capsys, ["lab", "coverage", *arguments], code=2).err
