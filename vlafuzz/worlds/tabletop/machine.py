"""Checks of this machine: the simulator's packages, what draws pictures, and where built objects are kept."""

import importlib.metadata
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from vlafuzz.common import assets
from vlafuzz.model.check import Check, Rating
from vlafuzz.worlds.tabletop import renderer

# Each package of the simulator, and what does not work if it cannot be imported.
PACKAGES = {
    "mani_skill": "no scene can be simulated",
    "sapien": "no scene can be simulated",
    "torch": "ManiSkill cannot be loaded",
}
# Run in a separate process, as an incompatible native library may crash.
_IMPORT = """
import importlib, json, sys
for name in sys.argv[1:]:
    try:
        importlib.import_module(name)
        problem = None
    except Exception as error:
        problem = f"{type(error).__name__}: {error}"
    print("imported", json.dumps([name, problem]), flush=True)
"""


def checks() -> Iterator[Check]:
    """All checks; they take some seconds, mostly for loading the simulator."""
    yield from _packages()
    probed = renderer.probe()
    if probed.works:
        software = "llvmpipe" in (probed.device or "")
        yield Check("renderer", probed.name, "ok", "in software: pictures cost more than physics" if software else "")
    else:
        lost = "policies without camera (expert, pinhole) run; pictures, videos and policies that see do not"
        yield Check("renderer", probed.problem or "", "warn", f"{lost}; hint: {renderer.HINT}")
    yield check_cache(assets.cache_dir())


def _packages() -> Iterator[Check]:
    problems = _import_problems(list(PACKAGES))
    for name, follows in PACKAGES.items():
        try:
            version = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            version = "not installed"
        problem = problems[name]
        if problem is None:
            yield Check(name, version)
        else:
            yield Check(name, f"{version}: {problem}", "refuse", f"{follows}; hint: run scripts/setup")


def check_cache(folder: Path) -> Check:
    built = sum(not path.name.startswith(".") for path in folder.glob("objects/*"))
    contents = f"{folder}, {built} objects built"
    existing = next(path for path in (folder.absolute(), *folder.absolute().parents) if path.exists())
    if os.access(existing, os.W_OK | os.X_OK):
        return Check("cache", contents, "ok", "" if built else "objects are built when they are first used")
    verdict: Rating = "warn" if built else "refuse"
    follows = "no further object can be built; hint: set VLAFUZZ_CACHE to a folder that you may write"
    return Check("cache", f"{contents}, not writable", verdict, follows)


def _import_problems(names: list[str]) -> dict[str, str | None]:
    """By package, the error that importing it raises; None where it works."""
    command = [sys.executable, "-c", _IMPORT, *names]
    problems: dict[str, str | None] = dict.fromkeys(names, "the import crashed")
    try:
        child = subprocess.run(command, capture_output=True, text=True, timeout=180, check=False)
    except subprocess.TimeoutExpired:
        return dict.fromkeys(names, "no import within 180 s")
    for line in child.stdout.splitlines():
        if line.startswith("imported "):
            name, problem = json.loads(line.removeprefix("imported "))
            problems[name] = problem
    return problems
