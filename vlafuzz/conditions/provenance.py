"""What is installed here, for the manifests of runs."""

from __future__ import annotations

import subprocess
from collections.abc import Mapping
from importlib import metadata
from pathlib import Path

from vlafuzz import __version__

_PACKAGES = ("mani_skill", "sapien", "torch", "numpy", "scipy")


def versions() -> dict[str, str]:
    """Of vlafuzz and of the packages that matter, by name."""
    found = {"vlafuzz": __version__}
    for name in _PACKAGES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return found


def simulator(versions: Mapping[str, str]) -> str:
    """What scenes are run in."""
    return "/".join(f"{name} {versions.get(name)}" for name in ("vlafuzz", "mani_skill", "sapien"))


def commit() -> str | None:
    """Of the checkout that this package is in, if it is one."""
    here = Path(__file__).resolve().parents[1]
    if not (here.parent / ".git").exists():
        return None
    try:
        done = subprocess.run(
            ["git", "-C", str(here), "rev-parse", "HEAD"],
            capture_output=True,
            text=True,
            timeout=5,
            check=True,
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip()
