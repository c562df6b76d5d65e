"""The code and the packages that are installed, as conditions keep them."""

import json
import subprocess
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict
from importlib import metadata
from pathlib import Path
from typing import Any

from vlafuzz import __version__
from vlafuzz.common.plugins import source_digest
from vlafuzz.policies.base import ActionSpec, Policy, PolicySpec
from vlafuzz.worlds import place

_PACKAGES = ("mani_skill", "sapien", "torch", "numpy", "scipy")


def here(name: str, policy: Policy, renderer: Callable[[], str], *, workers: bool = False) -> dict[str, Any]:
    """The fields of conditions that come with what is installed (``Origin.HERE``), whatever the world."""
    return {
        "spec": described(policy.spec),
        "source": source_digest(name, policy),
        "commit": commit(),
        "place": place.here(name, policy.spec, renderer, workers=workers),
    }


def described(spec: PolicySpec) -> str:
    """A spec as JSON. Keys are older than some fields, so they leave these out where they are as before."""
    fields = asdict(spec)
    if not spec.calibrated:
        del fields["calibrated"]
    if spec.action.width == ActionSpec().width:
        del fields["action"]["width"]
    return json.dumps(fields, sort_keys=True)


def versions() -> dict[str, str]:
    """Versions of vlafuzz and of the packages that matter, by name."""
    installed = {"vlafuzz": __version__}
    for name in _PACKAGES:
        with suppress(metadata.PackageNotFoundError):
            installed[name] = metadata.version(name)
    return installed


def commit() -> str | None:
    """The commit of the checkout that this package is in, if it is in one."""
    here = Path(__file__).resolve().parents[1]
    if not (here.parent / ".git").exists():
        return None
    try:
        command = ["git", "-C", str(here), "rev-parse", "HEAD"]
        return subprocess.check_output(command, stderr=subprocess.DEVNULL, text=True, timeout=5).strip()
    except (OSError, subprocess.SubprocessError):
        return None
