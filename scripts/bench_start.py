#!/usr/bin/env python
"""Seconds from the command `vlafuzz run` to its first proposal and its first outcome, best of several.

Each run is a process of its own, with a new store and two workers unless --workers says otherwise. A wrapper around the
strategy notes when it is first asked and first told, in a batch of one scene, how much CPU time the process itself has
taken by then, and which heavy libraries it has loaded. Start it twice: the first time fills caches.
"""

from __future__ import annotations

import argparse
import atexit
import json
import os
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

REPORT, BEGAN, STRATEGY = "BENCH_START_REPORT", "BENCH_START_BEGAN", "BENCH_START_STRATEGY"
HEAVY = [
    *("torch", "mani_skill", "sapien", "gymnasium", "trimesh", "sklearn", "pymoo", "pandas", "matplotlib"),
    *("scipy.optimize", "scipy.stats", "scipy.spatial", "ray", "cv2", "jinja2", "pydantic"),
]


class Timed:
    """A strategy that notes the time since the command, and what is loaded, at its first ask and tell."""

    def __init__(self, space: Any, seed: int, budget: int | None) -> None:
        from vlafuzz.search.registry import strategy_factory

        self._strategy = strategy_factory(os.environ[STRATEGY])(space, seed, budget)
        self._noted: dict[str, Any] = {}
        atexit.register(self._write)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._strategy, name)

    def ask(self, n: int) -> Any:
        self._note("asked")
        proposals = self._strategy.ask(n)
        self._note("proposed")
        return proposals

    def tell(self, proposals: Any, scores: Any) -> None:
        self._note("outcome")
        self._strategy.tell(proposals, scores)

    def _note(self, event: str) -> None:
        if event not in self._noted:
            seconds = time.monotonic() - float(os.environ[BEGAN])
            loaded = [name for name in HEAVY if name in sys.modules]
            self._noted[event] = (seconds, time.process_time(), loaded)

    def _write(self) -> None:
        self._note("end")
        Path(os.environ[REPORT]).write_text(json.dumps(self._noted), encoding="utf-8")


def measure(policy: str, strategy: str, workers: int, folder: Path) -> dict[str, Any]:
    """One run of one scene: seconds and libraries by event."""
    report, store = folder / "report.json", folder / "start.db"
    store.unlink(missing_ok=True)
    flags = {"policy": policy, "strategy": "python:bench_start:Timed", "store": store, "workers": workers}
    words = [f"--{name}={value}" for name, value in flags.items()]
    environment = os.environ | {REPORT: str(report), STRATEGY: strategy, BEGAN: str(time.monotonic())}
    environment["PYTHONPATH"] = f"{Path(__file__).parent}:{os.environ.get('PYTHONPATH', '')}"
    command = [sys.executable, "-m", "vlafuzz", "run", "--budget=2", "--no-certify", *words]
    command += ["--config=batch=1"]
    subprocess.run(command, env=environment, check=True, capture_output=True)
    noted: dict[str, Any] = json.loads(report.read_text(encoding="utf-8"))
    return noted


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--policies", default="pinhole,mini")
    parser.add_argument("--strategy", default="causes")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--repeats", type=int, default=3)
    chosen = parser.parse_args(arguments)
    with TemporaryDirectory() as folder:
        for policy in chosen.policies.split(","):
            runs = [measure(policy, chosen.strategy, chosen.workers, Path(folder)) for _ in range(chosen.repeats)]
            for event in ("asked", "proposed", "outcome", "end"):
                seconds, cpu, loaded = min(run[event] for run in runs if event in run)
                print(f"{policy:8} {event:9} {seconds:6.2f} s, {cpu:5.2f} s of CPU here  {' '.join(loaded)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
