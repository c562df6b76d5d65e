#!/usr/bin/env python
"""Check that corpora hold: run all of their scenes again, on the machine at hand.

A failure holds if the policy fails no later than at the recorded stage, a counterpart if it passes, a witness if its
actions solve the scene. Failures are rolled out once as they are, and five times in their neighbourhood, where the
majority counts. With --arithmetic all is done in four arithmetics, in which processor, torch and software renderer give
other last bits. Exit code 1: a figure is below its bound.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

from vlafuzz.common.statistics import Share
from vlafuzz.failures.corpus.corpus import Case
from vlafuzz.failures.corpus.folder import read_corpus
from vlafuzz.model import Outcome, Verdict
from vlafuzz.rollouts.scene_runner import SimulatorSceneRunner
from vlafuzz.worlds.manipulation.jitter import jittered

ARITHMETICS = {
    "native": {},
    "AVX2": {"ATEN_CPU_CAPABILITY": "avx2", "ONEDNN_MAX_CPU_ISA": "AVX2"},
    "SSE4.1": {"ATEN_CPU_CAPABILITY": "default", "ONEDNN_MAX_CPU_ISA": "SSE41"},
    "128-bit lavapipe": {"LP_NATIVE_VECTOR_WIDTH": "128", "GALLIUM_OVERRIDE_CPU_CAPS": "avx"},
}
BOUNDS = {"majority of five": 0.99, "single": 0.97, "counterpart": 0.97, "witness": 1.0}
FIRST = 5_000_000  # number of the first jitter: no other part of vlafuzz uses these
REPEATS = 5
PART = 8  # cases that one process checks


@dataclass(frozen=True)
class Job:
    """Some cases of a corpus, to be checked in a process of their own."""

    folder: Path
    first: int

    def run(self) -> list[tuple[str, str, bool]]:
        """Scene, kind and whether it held, of every check."""
        corpus = read_corpus(self.folder)
        cases = corpus.cases[self.first : self.first + PART]
        checks: list[tuple[str, str, bool]] = []
        for run in sorted({case.run for case in cases}):
            with closing(SimulatorSceneRunner(self.folder, corpus.runs[run])) as runner:
                for case in (case for case in cases if case.run == run):
                    checks += ((case.scene.digest[:12], *check) for check in _check(case, runner))
        return checks


def _check(case: Case, runner: SimulatorSceneRunner) -> Iterator[tuple[str, bool]]:
    lost = runner.stages[: runner.stages.index(case.lost_stage) + 1]
    numbers = [FIRST + number for number in range(REPEATS)]
    around = [jittered(case.scene, number) for number in numbers]
    single, *repeats = runner.evaluate([case.scene, *around], [FIRST, *numbers])
    yield "single", single.lost_stage in lost
    yield "majority of five", _most(outcome.lost_stage in lost for outcome in _judged(repeats))
    yield "witness", runner.play(case.scene, case.witness.actions).verdict is Verdict.PASSED
    counterparts = list(case.counterparts.values())
    for outcome in runner.evaluate(counterparts, [FIRST] * len(counterparts)):
        yield "counterpart", outcome.verdict is Verdict.PASSED


def _judged(outcomes: Sequence[Outcome]) -> list[Outcome]:
    return [outcome for outcome in outcomes if outcome.verdict >= Verdict.PASSED]


def _most(held: Iterator[bool]) -> bool:
    answers = list(held)
    return 2 * sum(answers) > len(answers)


def main() -> None:
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    parser.add_argument("corpora", type=Path, nargs="+", help="folders")
    parser.add_argument("--arithmetic", action="store_true", help=f"under {', '.join(ARITHMETICS)}")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1, help="processes at a time")
    parser.add_argument("--out", type=Path, help="JSON file for the figures")
    options = parser.parse_args()
    jobs = [
        Job(folder, first) for folder in options.corpora for first in range(0, len(read_corpus(folder).cases), PART)
    ]
    rows: list[dict[str, object]] = []
    for name in ARITHMETICS if options.arithmetic else ("native",):
        rows += _figures(name, _counts(name, jobs, options.workers))
    if options.out:
        options.out.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    sys.exit(int(any(row["below"] for row in rows)))


def _counts(name: str, jobs: Sequence[Job], workers: int) -> Counter[tuple[str, str, bool]]:
    """Checks by corpus, kind and whether they held, in one arithmetic."""
    counts: Counter[tuple[str, str, bool]] = Counter()
    began = time.monotonic()
    with _environment(ARITHMETICS[name]), get_context("spawn").Pool(workers, maxtasksperchild=1) as pool:
        for number, (job, checks) in enumerate(pool.imap_unordered(_run, jobs, chunksize=1), start=1):
            counts.update((job.folder.name, kind, held) for _, kind, held in checks)
            broken = [f"{scene} {kind}" for scene, kind, held in checks if not held]
            progress = f"{name}: {number} of {len(jobs)} parts, {time.monotonic() - began:.0f} s; broken: "
            print(progress + (", ".join(broken) or "none"), file=sys.stderr, flush=True)
    return counts


def _run(job: Job) -> tuple[Job, list[tuple[str, str, bool]]]:
    return job, job.run()


@contextmanager
def _environment(variables: dict[str, str]) -> Iterator[None]:
    """Processes that are started in the block have these variables, and one thread."""
    before = dict(os.environ)
    os.environ.update(variables, OMP_NUM_THREADS="1", LP_NUM_THREADS="0")
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(before)


def _figures(name: str, counts: Counter[tuple[str, str, bool]]) -> list[dict[str, object]]:
    """One row per corpus and kind of check, and one for all corpora together; also printed."""
    rows: list[dict[str, object]] = []
    corpora = sorted({corpus for corpus, _, _ in counts})
    for kind, bound in BOUNDS.items():
        for corpus in (*corpora, "all"):
            counted = [key for key in counts if key[1] == kind and corpus in (key[0], "all")]
            held = sum(counts[key] for key in counted if key[2])
            share = Share.of_counts(held, sum(counts[key] for key in counted))
            below = corpus == "all" and share.share < bound
            rows.append(
                {"arithmetic": name, "corpus": corpus, "kind": kind, "held": held, "of": share.of}
                | {"low": share.low, "high": share.high, "below": below}
            )
            mark = f"  below {bound:.0%}" if below else ""
            print(f"{name:18}{corpus:16}{kind:18}{held:5} of {share.of:5} = {share}{mark}", flush=True)
    return rows


if __name__ == "__main__":
    main()
