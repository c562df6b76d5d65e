"""An exported corpus reads back as it was, and what is wrong with a folder is one sentence."""

import hashlib
import io
import json
import os
from dataclasses import asdict, replace
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from tests.common.test_reading import in_little_memory
from tests.doubles import scene
from tests.failures.corpus.corpora import case, control, make_corpus
from vlafuzz.errors import CorpusError
from vlafuzz.failures.corpus.corpus import Corpus
from vlafuzz.failures.corpus.folder import is_corpus, read_corpus, witness_path, write_corpus
from vlafuzz.model.scene_lines import load_scenes, write_scenes


def plain(corpus: Corpus) -> dict[str, object]:
    """All fields, with arrays as bytes, since arrays do not compare."""
    values = asdict(corpus)
    for row in values["cases"]:
        row["witness"]["actions"] = row["witness"]["actions"].tobytes()
    return values | {"runs": list(values["runs"]), "cases": list(values["cases"])}


@pytest.mark.parametrize("controls", [0, 3])
def test_it_reads_back_as_it_was_and_its_scenes_are_a_file_of_scenes(tmp_path: Path, controls: int) -> None:
    cases = (
        case(number, run=number % 2, reference=reference)
        for number, reference in enumerate([None, scene(light=1 / 4, x=0.0002), scene(light=1 / 4)])
    )
    written = make_corpus(*cases, runs=2, controls=controls)
    write_corpus(written, tmp_path / "a")
    assert (is_corpus(tmp_path / "a"), is_corpus(tmp_path)) == (True, False)
    assert plain(read_corpus(tmp_path / "a")) == plain(written)
    assert load_scenes(tmp_path / "a" / "scenes.jsonl") == [case.scene for case in written.cases]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_corpus(make_corpus(case(1), case(2)), tmp_path / "a")
    return tmp_path / "a"


def complaint(folder: Path) -> str:
    with pytest.raises(CorpusError) as caught:
        read_corpus(folder)
    assert "\n" not in caught.value.message
    assert caught.value.hint
    return caught.value.message


def change(folder: Path, **changes: object) -> None:
    path = folder / "manifest.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))


def test_a_changed_witness_is_told(folder: Path) -> None:
    path = witness_path(folder, case(2).scene)
    np.save(path, np.load(path) * 1.01)
    assert complaint(folder).startswith(f"{path}: was changed: its digest is ")


def test_a_missing_witness_is_told(folder: Path) -> None:
    path = witness_path(folder, case(1).scene)
    path.unlink()
    assert complaint(folder) == f"{path}: cannot be read: no such file or directory"


def test_a_run_with_a_field_of_another_type_is_told(folder: Path) -> None:
    runs = json.loads((folder / "manifest.json").read_text())["runs"]
    change(folder, runs=[run | {"budget": "many"} for run in runs])
    says = "runs.0.budget: input should be a valid integer, unable to parse string as an integer, got 'many'"
    assert complaint(folder).endswith(says)


def test_schema_2_which_had_neither_controls_nor_rates_is_read(folder: Path) -> None:
    manifest = json.loads((folder / "manifest.json").read_text())
    del manifest["controls"]
    for row in manifest["cases"]:
        del row["certified"], row["counterpart_rates"], row["reference"], row["witness"]["solver"]
    (folder / "manifest.json").write_text(json.dumps(manifest | {"schema": 2}))
    read = read_corpus(folder)
    first = read.cases[0]
    assert (read.controls, first.certified, first.reference) == ((), None, None)
    assert first.witness.solver == "expert"


def test_a_newer_schema_is_told(folder: Path) -> None:
    change(folder, schema=4, something_new=True)
    assert complaint(folder) == f"{folder / 'manifest.json'}: schema 4 is newer than 3"


def test_a_missing_control_is_told(tmp_path: Path) -> None:
    write_corpus(make_corpus(controls=3), tmp_path / "b")
    manifest = tmp_path / "b" / "manifest.json"
    write_scenes(tmp_path / "b" / "controls.jsonl", [control(number).scene for number in range(2)])
    assert complaint(tmp_path / "b") == f"{manifest}: controls.2.scene: no scene with digest {control(2).scene.digest}"


def test_a_robot_that_is_not_installed_is_told(folder: Path) -> None:
    strange = [replace(scene, robot="gonzo") for scene in load_scenes(folder / "scenes.jsonl")]
    write_scenes(folder / "scenes.jsonl", strange)
    rows = json.loads((folder / "manifest.json").read_text())["cases"]
    change(folder, cases=[row | {"scene": other.digest} for row, other in zip(rows, strange, strict=True)])
    assert complaint(folder) == f"{folder / 'scenes.jsonl'}: case 0: robot: unknown robot 'gonzo'"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("{", "not JSON: Expecting"),
        ("[]", "input should be"),
        ("{}", "not the manifest of a corpus: no 'schema'"),
        ('{"schema": 1, "runs": [{}]}', "name: field required"),
        ('{"schema": 2}', "name: field required"),
    ],
)
def test_a_broken_manifest_is_told(folder: Path, text: str, says: str) -> None:
    (folder / "manifest.json").write_text(text)
    assert says in complaint(folder)


def test_scenes_that_are_not_those_of_the_manifest_are_told(folder: Path) -> None:
    write_scenes(folder / "scenes.jsonl", [scene(2.0)])
    assert f"cases.0.scene: no scene with digest {case(1).scene.digest}" in complaint(folder)


def test_a_folder_that_is_there_is_left_alone(folder: Path) -> None:
    with pytest.raises(CorpusError, match="exists already"):
        write_corpus(make_corpus(case(3)), folder)
    assert len(read_corpus(folder).cases) == 2


def test_nothing_is_left_where_it_cannot_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    full = OSError(28, os.strerror(28))
    monkeypatch.setattr("vlafuzz.failures.corpus.folder.write_scenes", Mock(side_effect=full))
    with pytest.raises(CorpusError, match="no space left on device"):
        write_corpus(make_corpus(), tmp_path / "a")
    assert list(tmp_path.iterdir()) == []


def forge(folder: Path, data: bytes) -> None:
    """Replace the actions of all witnesses, and their digests with them."""
    manifest = json.loads((folder / "manifest.json").read_text())
    for path in (folder / "witnesses").iterdir():
        path.write_bytes(data)
    digest = hashlib.blake2b(data, digest_size=16).hexdigest()
    cases = [row | {"witness": row["witness"] | {"digest": digest}} for row in manifest["cases"]]
    change(folder, cases=cases)


@pytest.mark.parametrize(
    ("shape", "says"),
    [
        ((1 << 40, 7), "no array"),
        ((7,), "not finite numbers, step by step"),
        ((2, 6), "actions of 6 numbers, and pick-up takes 7"),
    ],
)
def test_witnesses_of_another_shape_are_refused(folder: Path, shape: tuple, says: str) -> None:
    file = io.BytesIO()
    header = {"descr": "<f4", "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(file, header)
    forge(folder, file.getvalue() + bytes(28 if shape[0] == 7 else 48))
    with in_little_memory(), pytest.raises(CorpusError, match=says):
        read_corpus(folder)


@pytest.mark.parametrize(("field", "text"), [("packs", "[3]"), ("place", "{}"), ("scene_file", "x")])
def test_conditions_that_hold_other_json_are_refused(folder: Path, field: str, text: str) -> None:
    manifest = json.loads((folder / "manifest.json").read_text())
    change(folder, runs=[run | {field: text} for run in manifest["runs"]])
    with pytest.raises(CorpusError, match=r"manifest\.json: "):
        read_corpus(folder)
