"""What a rollout was made with: the code and packages that are installed, and the place that computes.

A place's arithmetic and renderer decide last bits, which decide some outcomes.
"""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, fields
from importlib import metadata
from pathlib import Path

from vlafuzz import __version__
from vlafuzz.common.assets import cpuinfo, kept
from vlafuzz.common.plugins import OBJECT, PREFIX
from vlafuzz.policies.base import ActionSpec, PolicySpec

_PACKAGES = ("mani_skill", "sapien", "torch", "numpy", "scipy")
# Limits that torch does not report, of the libraries that compute for it.
_LIMITS = ("ONEDNN_MAX_CPU_ISA", "DNNL_MAX_CPU_ISA", "MKL_ENABLE_INSTRUCTIONS", "MKL_CBWR")


@dataclass(frozen=True, kw_only=True)
class Place:
    """Where rollouts are computed, as far as it can decide their outcome.

    Attributes:
        processor: its architecture and, on Linux, its vendor: MKL chooses its kernels by both. instructions: the
        instruction set that torch uses, with the limits that are set for its libraries. torch: its version, with the
        build.
        threads: of torch; None for policies that fix their number or run behind a server.
        renderer: device and driver with its version; empty for policies without cameras.
    """

    processor: str
    instructions: str
    torch: str
    threads: int | None = None
    renderer: str = ""

    def __str__(self) -> str:
        return ", ".join(part for part in self._words() if part)

    def differences(self, other: Place) -> str:
        """This place in contrast to another one, ``AVX2 instead of AVX512``, where both are known."""
        pairs = zip(self._words(), other._words(), strict=True)
        differing = ((mine, theirs) for mine, theirs in pairs if mine and theirs and mine != theirs)
        return ", ".join(f"{mine} instead of {theirs}" for mine, theirs in differing)

    def _words(self) -> tuple[str, ...]:
        threads = "" if self.threads is None else f"{self.threads} thread{'s' * (self.threads != 1)}"
        return self.processor, self.instructions, f"torch {self.torch}", threads, self.renderer


def here(name: str, spec: PolicySpec, renderer: Callable[[], str], *, workers: bool = False) -> str:
    """This place for a policy, as JSON; empty if torch cannot be loaded, without which there is no simulator.

    Args:
        name: of the policy, as the user gave it.
        renderer: says what draws the world's pictures; it is asked for policies with cameras. workers: whether rollouts
        happen in worker processes, which have one thread each.
    """
    try:
        version, instructions = _torch()
        threads = (1 if workers else _threads()) if name.startswith((PREFIX, OBJECT)) else None
    except ImportError:
        return ""
    limits = [f"{name}={os.environ[name]}" for name in _LIMITS if os.environ.get(name)]
    place = Place(
        processor=_processor(),
        instructions=", ".join([instructions, *limits]),
        torch=version,
        threads=threads,
        renderer=renderer() if spec.cameras else "",
    )
    return json.dumps(asdict(place), sort_keys=True)


def in_words(place: str) -> str:
    """A place as conditions keep it, in words; empty if it is not known."""
    return str(_read(place)) if place else ""


def by_place(places: Mapping[int, str]) -> str:
    """The numbers of runs by their places, in words."""
    runs: dict[str, list[str]] = {}
    for number, place in places.items():
        runs.setdefault(in_words(place) or "not known", []).append(str(number))
    return "; ".join(f"run {', '.join(numbers)}: {words}" for words, numbers in runs.items())


def elsewhere(then: str, now: str) -> str:
    """Where something was made, in words that follow "made"; empty if that is where it is now."""
    if then == now:
        return ""
    if not (then and now):
        return "at a place that is not known"
    differences = _read(then).differences(_read(now))
    return f"at another place: {differences}" if differences else ""


def _read(place: str) -> Place:
    """A place as conditions keep it, without what later versions may have added."""
    known = {part.name for part in fields(Place)}
    return Place(**{name: value for name, value in json.loads(place).items() if name in known})


def _torch() -> tuple[str, str]:
    """Torch's version and instruction set: from the cache where possible, since its import takes a second."""
    if "torch" in sys.modules:
        return _ask_torch()
    version, instructions = kept("torch", _ask_torch, os.environ.get("ATEN_CPU_CAPABILITY"))
    return version, instructions


def _ask_torch() -> tuple[str, str]:
    import torch

    return str(torch.__version__), torch.backends.cpu.get_cpu_capability()


def _threads() -> int:
    import torch

    return torch.get_num_threads()


def _processor() -> str:
    vendor = cpuinfo("vendor_id")
    return f"{platform.machine()} {vendor}" if vendor else platform.machine()


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
