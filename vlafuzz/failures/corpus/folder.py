"""Corpora as folders: written completely or not at all, and checked when they are read."""

import hashlib
import io
import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, fields
from itertools import chain
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, ConfigDict, TypeAdapter, ValidationError

from vlafuzz.common.assets import corpus_dir
from vlafuzz.common.files import replacing, writing
from vlafuzz.common.reading import MIB, first_problem, npy_array, read_bytes, read_json
from vlafuzz.errors import CorpusError, SceneError, VlafuzzError
from vlafuzz.failures.corpus.corpus import SCHEMA, Case, Control, Corpus, Evidence, Facts
from vlafuzz.model import Actions, Scene, Solver, Witness
from vlafuzz.model.conditions import as_kept, check_read, from_kept
from vlafuzz.model.evidence import check_operators
from vlafuzz.model.scene_lines import load_scenes, write_scenes
from vlafuzz.store.records import Manifest
from vlafuzz.worlds import world_of

MANIFEST, SCENES, COUNTERPARTS = "manifest.json", "scenes.jsonl", "counterparts.jsonl"
CONTROLS = "controls.jsonl"
_STRICT = ConfigDict(extra="forbid", allow_inf_nan=False)
_AGAIN = "`vlafuzz export STORE --minimal` writes a new one"
# What a corpus or case and its row in the manifest have in common; the other fields are files or digests.
_OF_CORPUS = ("name", "created", "renderer", "versions", "evidence")
_OF_CASE = tuple(fact.name for fact in fields(Facts))


@dataclass(frozen=True)
class _WitnessRow:
    """A witness: the digest of the file with its actions, and the rest."""

    __pydantic_config__ = _STRICT
    digest: str
    steps: int
    states_hash: str
    attempt: int
    solver: Solver = "expert"


@dataclass(frozen=True, kw_only=True)
class _CaseRow(Facts):
    """A case, with its witness by the digest of its file; ``thumbnail``: a picture of earlier versions, not read."""

    __pydantic_config__ = _STRICT
    witness: _WitnessRow
    thumbnail: bool = False


_Run = Annotated[Manifest, BeforeValidator(lambda kept: from_kept(kept) if isinstance(kept, dict) else kept)]


@dataclass(frozen=True, kw_only=True)
class _Manifest:
    """All of a corpus but the scenes and actions."""

    __pydantic_config__ = _STRICT
    schema: int
    name: str
    created: str
    renderer: str | None
    versions: Mapping[str, str]
    runs: tuple[_Run, ...]
    evidence: Evidence
    cases: tuple[_CaseRow, ...]
    controls: tuple[Control, ...] = ()


_ADAPTER: TypeAdapter[_Manifest] = TypeAdapter(_Manifest)


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


def write_corpus(corpus: Corpus, folder: Path) -> None:
    """Write a new folder; a CorpusError if it exists already, or cannot be written."""
    with whole(folder) as unfinished:
        _write(corpus, unfinished)


@contextmanager
def whole(folder: Path) -> Iterator[Path]:
    """A temporary folder that is renamed to ``folder`` at the end; checks like ``check_new``."""
    check_new(folder)
    with writing(folder, "give --out elsewhere", CorpusError), replacing(folder) as unfinished:
        yield unfinished


def check_new(folder: Path) -> None:
    """Raise a CorpusError if a folder exists already, or cannot be written."""
    if folder.exists():
        raise CorpusError(f"{folder}: exists already", hint="give --out a new folder")
    with writing(folder, "give --out elsewhere", CorpusError):
        folder.mkdir()
        folder.rmdir()


def _write(corpus: Corpus, folder: Path) -> None:
    (folder / "witnesses").mkdir(parents=True)
    beside = ((*case.counterparts.values(), case.nominal, case.reference) for case in corpus.cases)
    write_scenes(folder / SCENES, [case.scene for case in corpus.cases])
    write_scenes(folder / COUNTERPARTS, dict.fromkeys(filter(None, chain.from_iterable(beside))))
    if corpus.controls:
        write_scenes(folder / CONTROLS, [control.scene for control in corpus.controls])
    for case in corpus.cases:
        witness_path(folder, case.scene).write_bytes(_npy(case.witness.actions))
    manifest = _Manifest(
        schema=SCHEMA,
        runs=tuple(corpus.runs),
        cases=tuple(map(_row, corpus.cases)),
        controls=tuple(corpus.controls),
        **_fields(corpus, _OF_CORPUS),
    )
    content = _ADAPTER.dump_python(manifest, mode="json") | {"runs": [as_kept(run) for run in manifest.runs]}
    (folder / MANIFEST).write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def _row(case: Case) -> _CaseRow:
    actions, witness = case.witness.actions, case.witness
    kept = _WitnessRow(_digest(_npy(actions)), len(actions), witness.states_hash, witness.attempt, witness.solver)
    return _CaseRow(witness=kept, **_fields(case, _OF_CASE))


def _fields(value: object, names: tuple[str, ...]) -> dict[str, Any]:
    return {name: getattr(value, name) for name in names}


def read_corpus(folder: Path) -> Corpus:
    """Read a folder that ``write_corpus`` wrote, and check that its parts belong together.

    Raises:
        CorpusError: the folder is not a corpus, has a newer schema, or a file is missing or was changed; the message
            names the file.
    """
    folder = locate(folder)
    manifest = _read_manifest(folder / MANIFEST, folder)
    cases = [_case(folder, number, row) for number, row in enumerate(manifest.cases)]
    return Corpus(runs=manifest.runs, cases=cases, controls=manifest.controls, **_fields(manifest, _OF_CORPUS))


def _read_manifest(path: Path, folder: Path) -> _Manifest:
    content = read_json(path, CorpusError, hint="expected an exported corpus", inside=folder)
    try:
        schema = content["schema"] if isinstance(content, dict) else None
        if isinstance(schema, int) and schema > SCHEMA:
            raise CorpusError(f"{path}: schema {schema} is newer than {SCHEMA}", hint="upgrade vlafuzz")
        files = (SCENES, COUNTERPARTS, *([CONTROLS] if (folder / CONTROLS).is_file() else []))
        scenes = {scene.digest: scene for file in files for scene in load_scenes(folder / file, folder)}

        def kept(digest: str) -> Scene:
            if digest not in scenes:
                raise ValueError(f"no scene with digest {digest}")
            return scenes[digest]

        manifest = _ADAPTER.validate_python(content, context=kept)
        for run in manifest.runs:
            check_read(run)
        for row in manifest.cases:
            check_operators(row.causes, row.operators, row.counterparts, row.counterpart_rates)
    except CorpusError:
        raise
    except SceneError as error:
        raise _damaged(error.message) from None
    except ValidationError as error:
        raise _damaged(f"{path}: {first_problem(error)}") from None
    except VlafuzzError as error:
        raise _damaged(f"{path}: {error.message}") from None
    except (KeyError, ValueError, TypeError, AttributeError) as error:
        problem = f"no {error}" if isinstance(error, KeyError) else str(error)
        raise _damaged(f"{path}: not the manifest of a corpus: {problem}") from None
    if not manifest.cases or any(not 0 <= case.run < len(manifest.runs) for case in manifest.cases):
        raise _damaged(f"{path}: has no case, or a case without its run")
    return manifest


def _case(folder: Path, number: int, row: _CaseRow) -> Case:
    failing = row.scene
    try:
        world = world_of(failing.task)
        world.robot(failing.robot)
    except SceneError as error:
        raise CorpusError(f"{folder / SCENES}: case {number}: {error.message}", hint=error.hint) from None
    path = witness_path(folder, failing)
    actions = _read_actions(path, row.witness.digest, folder)
    if actions.shape[1] != world.action_width:
        wanted = f"{failing.task} takes {world.action_width}"
        raise _damaged(f"{path}: actions of {actions.shape[1]} numbers, and {wanted}")
    return Case(
        witness=Witness(actions, row.witness.states_hash, row.witness.attempt, row.witness.solver),
        **_fields(row, _OF_CASE),
    )


def _read_actions(path: Path, digest: str, folder: Path) -> Actions:
    data = read_bytes(path, CorpusError, _AGAIN, most=16 * MIB, inside=folder)
    if _digest(data) != digest:
        raise _damaged(f"{path}: was changed: its digest is {_digest(data)}, not {digest}")
    try:
        actions = npy_array(data).astype(np.float32)
    except ValueError as error:
        raise _damaged(f"{path}: {error}") from None
    if actions.ndim != 2 or not np.isfinite(actions).all():
        raise _damaged(f"{path}: not finite numbers, step by step, but {actions.shape}")
    return actions


def _damaged(problem: str) -> CorpusError:
    return CorpusError(problem, _AGAIN)


def _npy(actions: Actions) -> bytes:
    file = io.BytesIO()
    np.save(file, np.ascontiguousarray(actions, dtype="<f4"), allow_pickle=False)
    return file.getvalue()


def _digest(data: bytes) -> str:
    return hashlib.blake2b(data, digest_size=16).hexdigest()
