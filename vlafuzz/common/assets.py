"""Locates data: what comes with vlafuzz, the cache of what is built once, and the user's folders.

The latter hold files that may not be shipped, such as robots.
"""

import errno
import hashlib
import importlib.util
import json
import os
import re
import shutil
from collections.abc import Callable, Iterable
from contextlib import suppress
from importlib.resources import files
from pathlib import Path
from typing import Any

from platformdirs import user_cache_path

from vlafuzz.common.files import reason
from vlafuzz.errors import PrerequisiteError

_PACKAGE = Path(str(files("vlafuzz")))
FOLDERS = "VLAFUZZ_PACKS"  # environment variable with a list of folders as in PATH
_KEPT = "answer.json"
_UNWRITABLE = (errno.EACCES, errno.EPERM, errno.EROFS, errno.ENOSPC, errno.EDQUOT, errno.ENOTDIR, errno.EEXIST)


def add_folders(folders: Iterable[Path]) -> None:
    """Search these folders first, in this process and in its children."""
    added = [str(folder.resolve()) for folder in folders]
    if added:
        os.environ[FOLDERS] = os.pathsep.join(added + [folder for folder in listed() if folder not in added])


def listed() -> list[str]:
    return [folder for folder in os.environ.get(FOLDERS, "").split(os.pathsep) if folder]


def find(path: str) -> Path | None:
    """The first match of a relative path, such as ``robots/widowx/wx250s.urdf``; None without any."""
    places = (Path(folder) / path for folder in listed())
    return next((place for place in places if place.exists()), None)


def need(path: str, what: str) -> Path:
    """Find a path as ``find`` does; a PrerequisiteError, which says ``what`` needs the file, if it is nowhere."""
    place = find(path)
    if place is None:
        folders = ", ".join(listed())
        raise PrerequisiteError(
            f"{what}: needs {path}, which {'is not in ' + folders if folders else 'no folder was named for'}",
            hint=f"name the folder that holds {path.split('/')[0]}/ in {FOLDERS}, or run with --pack",
        )
    return place


def _folder(name: str) -> Path:
    """A data folder: inside the package in a wheel, beside it in a checkout."""
    packed = _PACKAGE / "_shipped" / name
    return packed if packed.is_dir() else _PACKAGE.parent / name


def operators_dir() -> Path:
    """The folder of operator ranges, instruction templates and object catalogues."""
    return _folder("operators")


def corpus_dir() -> Path:
    return _folder("corpus")


def cache_dir() -> Path:
    """The cache folder: ``$VLAFUZZ_CACHE``, or the platform's default such as ``~/.cache/vlafuzz``."""
    return Path(os.environ.get("VLAFUZZ_CACHE") or user_cache_path("vlafuzz", appauthor=False))


def made_once(name: str, fill: Callable[[Path], None], is_complete: Callable[[Path], bool]) -> Path:
    """A folder of the cache, which is created by ``fill`` unless it exists and ``is_complete``.

    The folder appears complete or not at all, also when several processes create it at the same time.
    """
    folder = cache_dir() / name
    if is_complete(folder):
        return folder
    from filelock import FileLock

    draft = folder.with_name(f".{folder.name}")
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with FileLock(f"{draft}.lock"):
            if not is_complete(folder):
                for old in (draft, folder):  # of a process that was killed, or damaged
                    shutil.rmtree(old, ignore_errors=True)
                draft.mkdir()
                fill(draft)
                draft.rename(folder)
    except OSError as error:
        if error.errno not in _UNWRITABLE:
            raise
        hint = "make room there, or name another folder in VLAFUZZ_CACHE"
        raise PrerequisiteError(f"the cache {folder.parent} cannot be written: {reason(error)}", hint) from None
    return folder


def cpuinfo(entry: str) -> str | None:
    """An entry of the first processor, where there is ``/proc/cpuinfo`` and it has the entry."""
    with suppress(OSError):
        line = re.search(rf"^{entry}\s*: (.*)", Path("/proc/cpuinfo").read_text(), re.MULTILINE)
        return line and line[1]
    return None


def kept(name: str, ask: Callable[[], Any], *given: object) -> Any:
    """An answer, as JSON has it, that depends on torch, the processor and what else is given.

    It is asked for once, and then comes from the cache where that can be written.
    """
    torch = importlib.util.find_spec("torch")
    if torch is None or torch.origin is None:
        return ask()
    depends = [torch.origin, os.stat(torch.origin).st_mtime_ns, *given]
    depends += [cpuinfo("flags"), cpuinfo("Features")]  # of x86 and of Arm
    digest = hashlib.blake2b(json.dumps(depends).encode(), digest_size=8).hexdigest()

    def keep(folder: Path) -> None:
        (folder / _KEPT).write_text(json.dumps(ask()), encoding="utf-8")

    try:
        folder = made_once(f"{name}/{digest}", keep, lambda folder: (folder / _KEPT).is_file())
        return json.loads((folder / _KEPT).read_text(encoding="utf-8"))
    except (OSError, ValueError, PrerequisiteError):
        return ask()
