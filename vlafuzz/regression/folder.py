"""Bundles as folders: written whole or not at all, and checked when they are read."""

from __future__ import annotations

import hashlib
import io
import json
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ConfigDict, TypeAdapter, ValidationError

from vlafuzz.errors import CorpusError, SceneError
from vlafuzz.evidence import Actions, Causes, Witness
from vlafuzz.formats.scene_lines import load_scenes, write_scenes
from vlafuzz.regression.corpus import SCHEMA, Case, Corpus, Evidence
from vlafuzz.rigs.robots import rig
from vlafuzz.scene import Scene
from vlafuzz.shipped import corpus_dir
from vlafuzz.store.records import Manifest

MANIFEST, SCENES, COUNTERPARTS = "manifest.json", "scenes.jsonl", "counterparts.jsonl"
_STRICT = ConfigDict(extra="forbid", allow_inf_nan=False)
_AGAIN = "`vlafuzz export STORE --minimal` writes a whole one"


@dataclass(frozen=True)
class _Proof:
    """A witness but for its actions, of which it has the digest."""

    __pydantic_config__ = _STRICT
    digest: str
    steps: int
    states_hash: str
    attempt: int


@dataclass(frozen=True)
class _Row:
    """A case in the manifest: scenes by their digests. See ``Case``."""

    __pydantic_config__ = _STRICT
    scene: str
    lost_stage: str
    signature: str
    operators: tuple[str, ...]
    causes: Causes
    counterparts: Mapping[str, str]
    nominal: str
    nominal_passes: bool
    witness: _Proof
    found: str
    run: int
    repeats: int
    failures: int
    rollouts: int
    thumbnail: bool


@dataclass(frozen=True)
class _Manifest:
    __pydantic_config__ = _STRICT
    schema: int
    name: str
    created: str
    renderer: str | None
    versions: Mapping[str, str]
    runs: tuple[Manifest, ...]
    evidence: Evidence
    cases: tuple[_Row, ...]


_ADAPTER: TypeAdapter[_Manifest] = TypeAdapter(_Manifest)


def write_corpus(corpus: Corpus, folder: Path) -> None:
    """Write a new folder.

    Raises:
        CorpusError: it is there already, or cannot be written.
    """
    with whole(folder) as unfinished:
        _write(corpus, unfinished)


@contextmanager
def whole(folder: Path) -> Iterator[Path]:
    """A new folder beside its place, which is moved there in the end, so that there is never half of one.

    Raises:
        CorpusError: it is there already, or cannot be written.
    """
    unfinished = check_new(folder)
    try:
        yield unfinished
        unfinished.rename(folder)
    except OSError as error:
        raise _unwritable(folder, error) from None
    finally:
        shutil.rmtree(unfinished, ignore_errors=True)


def check_new(folder: Path) -> Path:
    """That a folder is not there yet, and could be; where it is written first.

    Raises:
        CorpusError: it is, or could not.
    """
    if folder.exists():
        raise CorpusError(f"{folder}: is there already", hint="give --out a new folder")
    unfinished = folder.with_name(f".{folder.name}.part")
    try:
        shutil.rmtree(unfinished, ignore_errors=True)  # of an export that was killed
        unfinished.mkdir(parents=True)
        unfinished.rmdir()
    except OSError as error:
        raise _unwritable(folder, error) from None
    return unfinished


def _unwritable(folder: Path, error: OSError) -> CorpusError:
    reason = (error.strerror or "unknown reason").lower()
    return CorpusError(f"{folder}: cannot be written: {reason}", hint="give --out elsewhere")


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
    manifest = _Manifest(
        SCHEMA,
        corpus.name,
        corpus.created,
        corpus.renderer,
        corpus.versions,
        tuple(corpus.runs),
        corpus.evidence,
        tuple(map(_row, corpus.cases)),
    )
    (folder / MANIFEST).write_text(json.dumps(asdict(manifest), indent=1) + "\n", encoding="utf-8")


def witness_path(folder: Path, scene: Scene) -> Path:
    """Where the actions of a scene's witness are: no file says where a file is."""
    return folder / "witnesses" / f"{scene.digest}.npy"


def thumbnail_path(folder: Path, scene: Scene) -> Path:
    """Where the picture of a scene is."""
    return folder / "thumbnails" / f"{scene.digest}.png"


def _row(case: Case) -> _Row:
    witness = case.witness
    digest = _digest(_npy(witness.actions))
    return _Row(
        case.scene.digest,
        case.lost_stage,
        case.signature,
        case.operators,
        case.causes,
        {name: scene.digest for name, scene in case.counterparts.items()},
        case.nominal.digest,
        case.nominal_passes,
        _Proof(digest, len(witness.actions), witness.states_hash, witness.attempt),
        case.found,
        case.run,
        case.repeats,
        case.failures,
        case.rollouts,
        case.thumbnail is not None,
    )


def is_corpus(folder: Path) -> bool:
    """Whether a path, or the name of a shipped corpus, looks like an exported one."""
    return (locate(folder) / MANIFEST).is_file()


def locate(folder: Path) -> Path:
    """A name such as ``mini-pick-up`` is that of a shipped corpus, unless there is such a folder here."""
    shipped = corpus_dir() / folder.name
    return shipped if folder == Path(folder.name) and not folder.exists() and shipped.is_dir() else folder


def read_corpus(folder: Path) -> Corpus:
    """Read a folder that ``write_bundle`` wrote, and check that its parts belong together.

    Raises:
        CorpusError: it is none, is of a newer schema, or something in it is missing or was changed; the
            message names the file.
    """
    folder = locate(folder)
    manifest = _read_manifest(folder / MANIFEST)
    try:
        shown = {scene.digest: scene for scene in load_scenes(folder / SCENES)}
        shown |= {scene.digest: scene for scene in load_scenes(folder / COUNTERPARTS)}
    except SceneError as error:
        raise CorpusError(error.message, hint=_AGAIN) from None
    cases = [_case(folder, number, row, shown) for number, row in enumerate(manifest.cases)]
    if any(not 0 <= case.run < len(manifest.runs) for case in cases) or not cases:
        raise CorpusError(f"{folder / MANIFEST}: a case of a run that is not in it, or no case", hint=_AGAIN)
    return Corpus(
        manifest.name,
        manifest.runs,
        cases,
        manifest.evidence,
        manifest.renderer,
        manifest.versions,
        manifest.created,
    )


def _read_manifest(path: Path) -> _Manifest:
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
        schema = found["schema"] if isinstance(found, dict) else None
        if isinstance(schema, int) and schema > SCHEMA:
            raise CorpusError(f"{path}: schema {schema} is newer than {SCHEMA}", hint="upgrade vlafuzz")
        return _ADAPTER.validate_python(_upgraded(found) if schema == 1 else found)
    except OSError as error:
        reason = (error.strerror or "unknown reason").lower()
        raise CorpusError(f"{path}: cannot be read: {reason}", hint="expected an exported corpus") from None
    except ValidationError as error:
        problem = error.errors(include_url=False)[0]
        where = ".".join(map(str, problem["loc"]))
        shown = repr(problem["input"])[:60]
        raise CorpusError(f"{path}: {where}: {problem['msg'].lower()}, got {shown}", hint=_AGAIN) from None
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise CorpusError(f"{path}: not the manifest of a corpus: {error}", hint=_AGAIN) from None


def _upgraded(manifest: dict[str, Any]) -> dict[str, Any]:
    """A manifest of schema 1 as one of schema 2, in which what is tested is called the policy."""
    runs = [
        {"policy" if name == "subject" else name: value for name, value in run.items()}
        for run in manifest["runs"]
    ]
    return manifest | {"schema": SCHEMA, "runs": runs}


def _case(folder: Path, number: int, row: _Row, shown: Mapping[str, Scene]) -> Case:
    def scene(digest: str, file: str) -> Scene:
        if digest not in shown:
            raise CorpusError(f"{folder / file}: case {number}: no scene with digest {digest}", hint=_AGAIN)
        return shown[digest]

    failing = scene(row.scene, SCENES)
    try:
        rig(failing.robot)
    except SceneError as error:
        raise CorpusError(f"{folder / SCENES}: case {number}: {error.message}", hint=error.hint) from None
    actions = _read_witness(witness_path(folder, failing), row.witness)
    return Case(
        failing,
        row.lost_stage,
        row.signature,
        row.operators,
        row.causes,
        {name: scene(digest, COUNTERPARTS) for name, digest in row.counterparts.items()},
        scene(row.nominal, COUNTERPARTS),
        row.nominal_passes,
        Witness(actions, row.witness.states_hash, row.witness.attempt),
        row.found,
        row.run,
        row.repeats,
        row.failures,
        row.rollouts,
        _read(thumbnail_path(folder, failing)) if row.thumbnail else None,
    )


def _read_witness(path: Path, proof: _Proof) -> Actions:
    data = _read(path)
    if _digest(data) != proof.digest:
        raise CorpusError(
            f"{path}: was changed: its digest is {_digest(data)}, not {proof.digest}", hint=_AGAIN
        )
    return np.asarray(np.load(io.BytesIO(data), allow_pickle=False), dtype=np.float32)


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        reason = (error.strerror or "unknown reason").lower()
        raise CorpusError(f"{path}: cannot be read: {reason}", hint=_AGAIN) from None


def _npy(actions: Actions) -> bytes:
    file = io.BytesIO()
    np.save(file, np.ascontiguousarray(actions, dtype="<f4"), allow_pickle=False)
    return file.getvalue()


def _digest(data: bytes) -> str:
    return hashlib.blake2b(data, digest_size=16).hexdigest()
