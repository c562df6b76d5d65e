"""``vlafuzz doctor``: what this machine has, or a policy is, and what follows from it."""

from __future__ import annotations

import importlib.metadata
import json as json_format
import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer

from vlafuzz import __version__, renderer, shipped
from vlafuzz.cli.examining import examine
from vlafuzz.cli.flags import OperatorsFlag
from vlafuzz.cli.output import print_rows
from vlafuzz.cli.packs import PackFlag, opened
from vlafuzz.diagnostics.check import Check, Rating
from vlafuzz.errors import UsageError

PYTHONS = ((3, 11), (3, 12))  # what pyproject.toml admits
PACKAGES = {
    "mani_skill": "no scene can be simulated",
    "sapien": "no scene can be simulated",
    "torch": "ManiSkill cannot be loaded",
}
LITTLE_DISK = 1e9  # bytes: some thousand videos
# In a process of its own, as a native library that does not fit may crash.
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


def doctor(
    policy: Annotated[
        str | None,
        typer.Option(help="Check this policy, or python:pkg.mod:factory.", show_default="this machine"),
    ] = None,
    task: Annotated[
        str | None, typer.Option(help="What the policy is told to do.", show_default="pick-up")
    ] = None,
    robot: Annotated[str | None, typer.Option(help="Whose hand it is.", show_default="panda")] = None,
    operators: OperatorsFlag = None,
    pack: PackFlag = None,
    seed: Annotated[
        int | None, typer.Option(help="The same seed gives the same scenes.", show_default="0")
    ] = None,
    n: Annotated[
        int | None,
        typer.Option("--n", help="Nominal scenes that the policy is to solve.", show_default="10"),
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")] = False,
) -> None:
    """Check this machine, or a policy: what is there, whether it works, and what follows from it.

    A policy is looked at in the simulator: whether it sees, hears, repeats itself and can do the task;
    where it fails, whether something is the wrong way round. Exit code 3: put something right first.
    """
    asked = {
        "task": task,
        "robot": robot,
        "operators": operators,
        "packs": opened(pack) or None,
        "seed": seed,
    }
    given = {name: value for name, value in asked.items() if value is not None}
    if policy is None and (given or n is not None):
        raise UsageError("nothing but --json goes without --policy", hint="name the policy to be checked")
    made = machine() if policy is None else examine(policy, given, 10 if n is None else n)
    checks, ended = _until_interrupted(made)
    if checks:
        print_rows([check._asdict() for check in checks], json=json)
    if not ended:
        raise typer.Abort
    if any(check.verdict == "refuse" for check in checks):
        raise typer.Exit(3)


def _until_interrupted(made: Iterator[Check]) -> tuple[list[Check], bool]:
    """The checks, and whether they came to their end: a slow policy may be asked for many minutes."""
    checks: list[Check] = []
    try:
        for check in made:
            checks += [check]
    except KeyboardInterrupt:
        return checks, False
    return checks, True


def machine() -> Iterator[Check]:
    """All checks; a few seconds, most of them for importing ManiSkill."""
    yield check_python()
    yield check_vlafuzz()
    yield from check_packages()
    yield check_cores()
    yield check_renderer(renderer.probe())
    yield check_cache(shipped.cache_dir())
    yield check_disk(Path.cwd())


def check_python() -> Check:
    fits = PYTHONS[0] <= sys.version_info[:2] <= PYTHONS[1]
    wanted = "" if fits else "hint: use Python 3.11 or 3.12"
    return Check("python", platform.python_version(), "ok" if fits else "warn", wanted)


def check_vlafuzz() -> Check:
    """The version, and the commit where this is a checkout."""
    top = Path(shipped.__file__).resolve().parent.parent
    commit = _git(top, "rev-parse", "--short", "HEAD") if (top / ".git").exists() else None
    if commit is None:
        return Check("vlafuzz", __version__, "ok", "")
    found = f"{__version__}, commit {commit}"
    if _git(top, "status", "--porcelain") == "":
        return Check("vlafuzz", found, "ok", "")
    return Check("vlafuzz", f"{found}, changed", "warn", "results cannot be traced to this commit alone")


def check_packages() -> Iterator[Check]:
    problems = _import_problems(list(PACKAGES))
    for name, follows in PACKAGES.items():
        try:
            version = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            version = "not installed"
        problem = problems[name]
        if problem is None:
            yield Check(name, version, "ok", "")
        else:
            yield Check(name, f"{version}: {problem}", "refuse", f"{follows}; hint: run scripts/setup")


def check_cores() -> Check:
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return Check("cores", str(cores), "ok", f"up to {cores} workers run side by side")


def check_renderer(found: renderer.Renderer) -> Check:
    if found.works:
        software = "llvmpipe" in (found.device or "")
        speed = "in software: pictures cost more than physics" if software else ""
        return Check("renderer", found.name, "ok", speed)
    follows = "policies without camera (expert, pinhole) run; pictures, videos and policies that see do not"
    return Check("renderer", found.problem or "", "warn", f"{follows}; hint: {renderer.HINT}")


def check_cache(folder: Path) -> Check:
    """Where built objects are kept."""
    built = len([each for each in folder.glob("objects/*") if not each.name.startswith(".")])
    found = f"{folder}, {built} objects built"
    if os.access(_existing(folder), os.W_OK | os.X_OK):
        return Check("cache", found, "ok", "" if built else "objects are built when they are first used")
    verdict: Rating = "warn" if built else "refuse"
    follows = "no further object can be built; hint: set VLAFUZZ_CACHE to a folder that you may write"
    return Check("cache", f"{found}, not writable", verdict, follows)


def check_disk(folder: Path) -> Check:
    free = shutil.disk_usage(_existing(folder)).free
    enough = free >= LITTLE_DISK
    follows = "" if enough else "stores and videos may not fit; hint: make room or work in another folder"
    return Check("disk", f"{free / 1e9:.1f} GB free here", "ok" if enough else "warn", follows)


def _import_problems(names: list[str]) -> dict[str, str | None]:
    """What goes wrong when each is imported, None where nothing does."""
    command = [sys.executable, "-c", _IMPORT, *names]
    problems: dict[str, str | None] = dict.fromkeys(names, "the import crashed")
    try:
        child = subprocess.run(command, capture_output=True, text=True, timeout=180, check=False)
    except subprocess.TimeoutExpired:
        return dict.fromkeys(names, "no import within 180 s")
    for line in child.stdout.splitlines():
        if line.startswith("imported "):
            name, problem = json_format.loads(line.removeprefix("imported "))
            problems[name] = problem
    return problems


def _git(folder: Path, *arguments: str) -> str | None:
    """What git answers; None where it does not."""
    try:
        child = subprocess.run(
            ["git", "-C", str(folder), *arguments], capture_output=True, text=True, check=False
        )
    except OSError:
        return None
    return child.stdout.strip() if child.returncode == 0 else None


def _existing(folder: Path) -> Path:
    """The folder, or the nearest above it that is there."""
    return next(each for each in (folder.absolute(), *folder.absolute().parents) if each.exists())
