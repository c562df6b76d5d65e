"""The code and the packages that are installed, as conditions keep them."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Mapping
from dataclasses import asdict
from importlib import metadata
from pathlib import Path
from typing import Any

from vlafuzz import __version__
from vlafuzz.objects import Catalogue
from vlafuzz.plugins import source_digest
from vlafuzz.policies.base import Policy

_PACKAGES = ("mani_skill", "sapien", "torch", "numpy", "scipy")


def here(name: str, policy: Policy, catalogue: Catalogue) -> dict[str, Any]:
    """The fields of conditions that come with what is installed (``Origin.HERE``).

    Args:
        name: of the policy.
    """
    return {
        "spec": json.dumps(asdict(policy.spec), sort_keys=True),
        "source": source_digest(name, policy),
        "catalogue_digest": catalogue.digest,
        "simulator": simulator(versions()),
        "commit": commit(),
    }


def versions() -> dict[str, str]:
    """Versions of vlafuzz and of the packages that matter, by name."""
    installed = {"vlafuzz": __version__}
    for name in _PACKAGES:
        try:
            installed[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return installed


def simulator(versions: Mapping[str, str]) -> str:
    """Name and version of the simulator."""
    return "/".join(f"{name} {versions.get(name)}" for name in ("vlafuzz", "mani_skill", "sapien"))


def commit() -> str | None:
    """The commit of the checkout that this package is in, if it is in one."""
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
