"""Processor: what the system says of it, and answers that depend on it and on torch, kept in the cache."""

import hashlib
import importlib.util
import json
import os
import re
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from vlafuzz.common import assets
from vlafuzz.errors import PrerequisiteError

_KEPT = "answer.json"


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
        folder = assets.made_once(f"{name}/{digest}", keep, lambda folder: (folder / _KEPT).is_file())
        return json.loads((folder / _KEPT).read_text(encoding="utf-8"))
    except (OSError, ValueError, PrerequisiteError):
        return ask()
