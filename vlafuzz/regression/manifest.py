"""The manifest of a corpus folder: the cases as rows that refer to files by the digests of their scenes."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ConfigDict, TypeAdapter, ValidationError

from vlafuzz.errors import CorpusError
from vlafuzz.evidence import Causes
from vlafuzz.files import reason
from vlafuzz.regression.corpus import SCHEMA, Evidence
from vlafuzz.store.records import Manifest

EXPORT_AGAIN = "`vlafuzz export STORE --minimal` writes a new one"
_STRICT = ConfigDict(extra="forbid", allow_inf_nan=False)


@dataclass(frozen=True)
class WitnessRow:
    """A witness: the digest of the file with its actions, and the rest."""

    __pydantic_config__ = _STRICT
    digest: str
    steps: int
    states_hash: str
    attempt: int


@dataclass(frozen=True, kw_only=True)
class CaseRow:
    """A case, with scenes by their digests. See ``Case``."""

    __pydantic_config__ = _STRICT
    scene: str
    lost_stage: str
    signature: str
    operators: tuple[str, ...]
    causes: Causes
    counterparts: Mapping[str, str]
    nominal: str
    nominal_passes: bool
    witness: WitnessRow
    found: str
    run: int
    repeats: int
    failures: int
    rollouts: int
    thumbnail: bool


@dataclass(frozen=True, kw_only=True)
class CorpusManifest:
    """All of a corpus but the scenes, actions and images."""

    __pydantic_config__ = _STRICT
    schema: int
    name: str
    created: str
    renderer: str | None
    versions: Mapping[str, str]
    runs: tuple[Manifest, ...]
    evidence: Evidence
    cases: tuple[CaseRow, ...]


_RENAMED = {"subject": "policy", "given": "scene_file"}
_ADAPTER: TypeAdapter[CorpusManifest] = TypeAdapter(CorpusManifest)


def read_manifest(path: Path) -> CorpusManifest:
    """Read and validate a manifest of any schema so far.

    Raises:
        CorpusError: the file cannot be read, is malformed, or has a newer schema.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        schema = content["schema"] if isinstance(content, dict) else None
        if isinstance(schema, int) and schema > SCHEMA:
            raise CorpusError(f"{path}: schema {schema} is newer than {SCHEMA}", hint="upgrade vlafuzz")
        manifest = _ADAPTER.validate_python(_upgraded(content) if schema == 1 else content)
    except OSError as error:
        message = f"{path}: cannot be read: {reason(error)}"
        raise CorpusError(message, hint="expected an exported corpus") from None
    except ValidationError as error:
        problem = error.errors(include_url=False)[0]
        where = ".".join(map(str, problem["loc"]))
        value = repr(problem["input"])[:60]
        raise CorpusError(
            f"{path}: {where}: {problem['msg'].lower()}, got {value}", hint=EXPORT_AGAIN
        ) from None
    except KeyError as error:
        raise CorpusError(f"{path}: not the manifest of a corpus: no {error}", hint=EXPORT_AGAIN) from None
    except (ValueError, TypeError, AttributeError) as error:
        raise CorpusError(f"{path}: not the manifest of a corpus: {error}", hint=EXPORT_AGAIN) from None
    if not manifest.cases or any(not 0 <= case.run < len(manifest.runs) for case in manifest.cases):
        raise CorpusError(f"{path}: has no case, or a case without its run", hint=EXPORT_AGAIN)
    return manifest


def _upgraded(content: dict[str, Any]) -> dict[str, Any]:
    """Schema 1 as schema 2, which renamed fields of the runs."""
    runs = [{_RENAMED.get(name, name): value for name, value in run.items()} for run in content["runs"]]
    return content | {"schema": SCHEMA, "runs": runs}
