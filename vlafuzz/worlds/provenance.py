"""What a rollout was made with: the code and packages that are installed, and the place that computes.

A place's arithmetic and renderer decide last bits, which decide some outcomes.
"""

import json
import os
import platform
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict
from importlib import metadata
from pathlib import Path

from vlafuzz import __version__
from vlafuzz.common.assets import cpuinfo, kept
from vlafuzz.common.plugins import OBJECT, PREFIX
from vlafuzz.policies.base import ActionSpec, PolicySpec

_PACKAGES = ("mani_skill", "sapien", "torch", "numpy", "scipy")
_CHOSEN = ("ATEN_CPU_CAPABILITY", "OMP_NUM_THREADS", "MKL_NUM_THREADS")  # by which torch computes as told
# Limits that torch does not report, of the libraries that compute for it.
_LIMITS = ("ONEDNN_MAX_CPU_ISA", "DNNL_MAX_CPU_ISA", "MKL_ENABLE_INSTRUCTIONS", "MKL_CBWR")


def here(name: str, spec: PolicySpec, renderer: Callable[[], str], *, workers: bool = False) -> str:
    """This place for a policy, as JSON; empty if torch cannot be loaded, without which there is no simulator.

    It has what can decide an outcome: ``processor``, its architecture and, on Linux, its vendor, by which MKL chooses
    its kernels; ``instructions``, the set that torch uses, with the limits that are set for its libraries; ``torch``,
    its version with the build; ``threads`` of torch, None for policies that fix their number or run behind a server;
    ``renderer``, device and driver with its version, empty for policies without cameras.

    Args:
        name: of the policy, as the user gave it.
        renderer: says what draws the world's pictures; it is asked for policies with cameras. workers: whether rollouts
        happen in worker processes, which have one thread each.
    """
    try:
        version, instructions, threads = _torch()
    except ImportError:
        return ""
    vendor = cpuinfo("vendor_id")
    limits = [f"{name}={os.environ[name]}" for name in _LIMITS if os.environ.get(name)]
    place = {
        "processor": f"{platform.machine()} {vendor}" if vendor else platform.machine(),
        "instructions": ", ".join([instructions, *limits]),
        "torch": version,
        "threads": (1 if workers else threads) if name.startswith((PREFIX, OBJECT)) else None,
        "renderer": renderer() if spec.cameras else "",
    }
    return json.dumps(place, sort_keys=True)


def in_words(place: str) -> str:
    """A place as conditions keep it, in words; empty if it is not known."""
    return ", ".join(filter(None, _words(place))) if place else ""


def elsewhere(then: str, now: str) -> str:
    """The place where something was made, in words that follow "made"; empty if it is this place."""
    if then == now:
        return ""
    if not (then and now):
        return "at a place that is not known"
    pairs = zip(_words(then), _words(now), strict=True)
    differing = [f"{one} instead of {other}" for one, other in pairs if one and other and one != other]
    return f"at another place: {', '.join(differing)}" if differing else ""


def _words(place: str) -> list[str]:
    """A place part by part, without what later versions may have added; empty where a part is not known."""
    said, threads = json.loads(place), json.loads(place).get("threads")
    counted = "" if threads is None else f"{threads} thread{'s' * (threads != 1)}"
    return [said["processor"], said["instructions"], f"torch {said['torch']}", counted, said.get("renderer", "")]


def _torch() -> tuple[str, str, int]:
    """Torch's version, instruction set and threads: from the cache where possible, since its import takes a second."""
    if "torch" in sys.modules:
        return _ask_torch()
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    version, instructions, threads = kept("torch", _ask_torch, cores, *map(os.environ.get, _CHOSEN))
    return version, instructions, threads


def _ask_torch() -> tuple[str, str, int]:
    import torch

    return str(torch.__version__), torch.backends.cpu.get_cpu_capability(), torch.get_num_threads()


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
