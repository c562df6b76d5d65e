"""The file of scenes that a run takes in order or chooses from, as its manifest keeps it."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path

from vlafuzz.errors import StoreError, UsageError
from vlafuzz.formats.scene_lines import load_scenes
from vlafuzz.formats.sources import is_vlatest
from vlafuzz.scene import Scene
from vlafuzz.store.records import Manifest


def read_scene_file(scenes: Path | None, pool: Path | None) -> list[Scene]:
    """The scenes of a file, to run or to choose from; none where neither file is named.

    Raises:
        UsageError: both files are named.
        SceneError: the file cannot be read.
    """
    if scenes and pool:
        raise UsageError("--scenes and --pool: both name a file of scenes", hint="leave one of the two out")
    path = scenes or pool
    if path and path.is_file() and is_vlatest(path):
        hint = "for VLATest's files: `vlafuzz import vlatest FILE --frame robot --out F.jsonl` writes some"
        raise UsageError(f"{path}: not JSON lines", hint=hint)
    return load_scenes(path) if path else []


def scene_file_json(scenes: Path | None, pool: Path | None, read: Sequence[Scene]) -> str:
    """The file as a manifest keeps it: purpose, path and digest of its scenes; empty without a file."""
    path = scenes or pool
    if path is None:
        return ""
    digest = hashlib.blake2b("\n".join(scene.digest for scene in read).encode(), digest_size=8).hexdigest()
    flag = "scenes" if scenes else "pool"
    return json.dumps({"flag": flag, "file": str(path.resolve()), "digest": digest})


def stored_flag(manifest: Manifest) -> dict[str, Path]:
    """The flag that names a run's file of scenes, with the file; empty for a run without one."""
    mark = json.loads(manifest.scene_file or "{}")
    return {mark["flag"]: Path(mark["file"])} if mark else {}


def check_scene_file(path: object, run: int, was: Manifest, now: Manifest) -> None:
    """Check that the file still holds the scenes of the run.

    Raises:
        StoreError: it holds other scenes.
    """
    before, here = (json.loads(manifest.scene_file or "{}") for manifest in (was, now))
    if before and (before["flag"], before["digest"]) != (here.get("flag"), here.get("digest")):
        raise StoreError(
            f"{path}: run {run} had other scenes than {here.get('file', 'there are now')} holds",
            hint=f"give --{before['flag']} {before['file']} as it was then",
        )
