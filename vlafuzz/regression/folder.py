"""Corpora as folders: written completely or not at all, and checked when they are read."""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from vlafuzz.assets import corpus_dir
from vlafuzz.errors import CorpusError, SceneError
from vlafuzz.evidence import Actions, Witness
from vlafuzz.files import reason, replacing
from vlafuzz.formats.scene_lines import load_scenes, write_scenes
from vlafuzz.regression.corpus import SCHEMA, Case, Corpus
from vlafuzz.regression.manifest import EXPORT_AGAIN, CaseRow, CorpusManifest, WitnessRow, read_manifest
from vlafuzz.rigs.robots import rig
from vlafuzz.scene import Scene

MANIFEST, SCENES, COUNTERPARTS = "manifest.json", "scenes.jsonl", "counterparts.jsonl"
# What a value and its row in the manifest have in common; the other fields are files or digests.
_OF_CORPUS = ("name", "created", "renderer", "versions", "evidence")
_OF_CASE = (
    "lost_stage", "signature", "operators", "causes", "nominal_passes", "found", "run", "repeats", "failures",
    "rollouts",
)  # fmt: skip


def locate(folder: Path) -> Path:
    """The folder itself; for the name of a shipped corpus that is no path here, the shipped folder."""
    shipped = corpus_dir() / folder.name
    return shipped if folder == Path(folder.name) and not folder.exists() and shipped.is_dir() else folder


def is_corpus(folder: Path) -> bool:
    """Whether a path, or the name of a shipped corpus, looks like an exported corpus."""
    return (locate(folder) / MANIFEST).is_file()


def witness_path(folder: Path, scene: Scene) -> Path:
    """The file with the actions of a scene's witness."""
    return folder / "witnesses" / f"{scene.digest}.npy"


def thumbnail_path(folder: Path, scene: Scene) -> Path:
    """The file with the image of a scene."""
    return folder / "thumbnails" / f"{scene.digest}.png"


def write_corpus(corpus: Corpus, folder: Path) -> None:
    """Write a new folder.

    Raises:
        CorpusError: the folder exists already, or cannot be written.
    """
    with whole(folder) as unfinished:
        _write(corpus, unfinished)


@contextmanager
def whole(folder: Path) -> Iterator[Path]:
    """A temporary folder that is renamed to ``folder`` at the end, so that it is complete or absent.

    Raises:
        CorpusError: the folder exists already, or cannot be written.
    """
    check_new(folder)
    try:
        with replacing(folder) as unfinished:
            yield unfinished
    except OSError as error:
        raise _unwritable(folder, error) from None


def check_new(folder: Path) -> None:
    """Check that a folder does not exist and can be created.

    Raises:
        CorpusError: the folder exists already, or cannot be written.
    """
    if folder.exists():
        raise CorpusError(f"{folder}: exists already", hint="give --out a new folder")
    try:
        folder.mkdir(parents=True)
        folder.rmdir()
    except OSError as error:
        raise _unwritable(folder, error) from None


def _unwritable(folder: Path, error: OSError) -> CorpusError:
    return CorpusError(f"{folder}: cannot be written: {reason(error)}", hint="give --out elsewhere")


def _write(corpus: Corpus, folder: Path) -> None:
    for part in ("witnesses", "thumbnails"):
        (folder / part).mkdir(parents=True)
    others = [scene for case in corpus.cases for scene in (*case.counterparts.values(), case.nominal)]
    write_scenes(folder / SCENES, [case.scene for case in corpus.cases])
    write_scenes(folder / COUNTERPARTS, dict.fromkeys(others))
    for case in corpus.cases:
        witness_path(folder, case.scene).write_bytes(_npy(case.witness.actions))
        if case.thumbnail is not None:
            thumbnail_path(folder, case.scene).write_bytes(case.thumbnail)
    rows, runs = tuple(map(_row, corpus.cases)), tuple(corpus.runs)
    manifest = CorpusManifest(schema=SCHEMA, cases=rows, runs=runs, **_fields(corpus, _OF_CORPUS))
    (folder / MANIFEST).write_text(json.dumps(asdict(manifest), indent=1) + "\n", encoding="utf-8")


def _row(case: Case) -> CaseRow:
    actions, witness = case.witness.actions, case.witness
    return CaseRow(
        scene=case.scene.digest,
        counterparts={name: scene.digest for name, scene in case.counterparts.items()},
        nominal=case.nominal.digest,
        witness=WitnessRow(_digest(_npy(actions)), len(actions), witness.states_hash, witness.attempt),
        thumbnail=case.thumbnail is not None,
        **_fields(case, _OF_CASE),
    )


def _fields(value: object, names: tuple[str, ...]) -> dict[str, Any]:
    return {name: getattr(value, name) for name in names}


def read_corpus(folder: Path) -> Corpus:
    """Read a folder that ``write_corpus`` wrote, and check that its parts belong together.

    Raises:
        CorpusError: the folder is not a corpus, has a newer schema, or a file is missing or was changed; the
            message names the file.
    """
    folder = locate(folder)
    manifest = read_manifest(folder / MANIFEST)
    try:
        scenes = {scene.digest: scene for scene in load_scenes(folder / SCENES)}
        scenes |= {scene.digest: scene for scene in load_scenes(folder / COUNTERPARTS)}
    except SceneError as error:
        raise CorpusError(error.message, hint=EXPORT_AGAIN) from None
    cases = [_case(folder, number, row, scenes) for number, row in enumerate(manifest.cases)]
    return Corpus(runs=manifest.runs, cases=cases, **_fields(manifest, _OF_CORPUS))


def _case(folder: Path, number: int, row: CaseRow, scenes: Mapping[str, Scene]) -> Case:
    def scene(digest: str, file: str) -> Scene:
        if digest not in scenes:
            message = f"{folder / file}: case {number}: no scene with digest {digest}"
            raise CorpusError(message, hint=EXPORT_AGAIN)
        return scenes[digest]

    failing = scene(row.scene, SCENES)
    try:
        rig(failing.robot)
    except SceneError as error:
        raise CorpusError(f"{folder / SCENES}: case {number}: {error.message}", hint=error.hint) from None
    actions = _read_actions(witness_path(folder, failing), row.witness.digest)
    return Case(
        scene=failing,
        counterparts={name: scene(digest, COUNTERPARTS) for name, digest in row.counterparts.items()},
        nominal=scene(row.nominal, COUNTERPARTS),
        witness=Witness(actions, row.witness.states_hash, row.witness.attempt),
        thumbnail=_read(thumbnail_path(folder, failing)) if row.thumbnail else None,
        **_fields(row, _OF_CASE),
    )


def _read_actions(path: Path, digest: str) -> Actions:
    data = _read(path)
    if _digest(data) != digest:
        message = f"{path}: was changed: its digest is {_digest(data)}, not {digest}"
        raise CorpusError(message, hint=EXPORT_AGAIN)
    return np.asarray(np.load(io.BytesIO(data), allow_pickle=False), dtype=np.float32)


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise CorpusError(f"{path}: cannot be read: {reason(error)}", hint=EXPORT_AGAIN) from None


def _npy(actions: Actions) -> bytes:
    file = io.BytesIO()
    np.save(file, np.ascontiguousarray(actions, dtype="<f4"), allow_pickle=False)
    return file.getvalue()


def _digest(data: bytes) -> str:
    return hashlib.blake2b(data, digest_size=16).hexdigest()
