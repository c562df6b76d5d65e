#!/usr/bin/env python
"""Check that corpora hold: run all of their scenes in fresh processes.

A verdict holds if the policy fails no later than at the recorded stage, a witness if it solves its scene, and
a counterpart (--counterparts) if the policy passes. The exit code is 1 if fewer than 99 % of the verdicts
hold, or if a witness fails.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

from vlafuzz.outcome import Verdict
from vlafuzz.regression.corpus import Case, Corpus
from vlafuzz.regression.folder import read_corpus
from vlafuzz.statistics import wilson
from vlafuzz.triage.scene_runner import SimulatorSceneRunner

HOLDS = 0.99


@dataclass(frozen=True)
class Job:
    """One check of all corpora."""

    number: int
    corpora: tuple[Path, ...]
    counterparts: bool

    def run(self) -> tuple[int, Counter[tuple[str, str, bool]], list[str]]:
        """Counts by (corpus, kind, held), and the checks that did not hold."""
        os.environ.update({"OMP_NUM_THREADS": "1", "LP_NUM_THREADS": "0"})
        counts: Counter[tuple[str, str, bool]] = Counter()
        broken = []
        for folder in self.corpora:
            corpus = read_corpus(folder)
            with closing(SimulatorSceneRunner(folder, corpus.runs[0])) as runner:
                for case in corpus.cases:
                    for kind, held in self._check(corpus, case, runner):
                        counts[corpus.name, kind, held] += 1
                        if not held:
                            broken.append(f"{corpus.name} {case.scene.digest[:12]} {kind}")
        return self.number, counts, broken

    def _check(self, corpus: Corpus, case: Case, runner: SimulatorSceneRunner) -> Iterator[tuple[str, bool]]:
        (outcome,) = runner.evaluate([case.scene], [0])
        stages = runner.stages
        lost = outcome.lost_stage
        yield "verdict", lost is not None and stages.index(lost) <= stages.index(case.lost_stage)
        yield "witness", runner.play(case.scene, case.witness.actions).verdict is Verdict.PASSED
        if self.counterparts:
            for outcome in runner.evaluate(list(case.counterparts.values()), [0] * len(case.counterparts)):
                yield "counterpart", outcome.verdict is Verdict.PASSED


def main() -> None:
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    parser.add_argument("corpora", type=Path, nargs="+", help="folders")
    parser.add_argument(
        "--processes", type=int, default=20, help="fresh processes, each of which checks everything"
    )
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1, help="processes at a time")
    parser.add_argument("--counterparts", action="store_true", help="run the passing scenes as well")
    parser.add_argument("--out", type=Path, help="JSON file for the figures")
    options = parser.parse_args()
    jobs = [Job(number, tuple(options.corpora), options.counterparts) for number in range(options.processes)]
    counts: Counter[tuple[str, str, bool]] = Counter()
    began = time.monotonic()
    with get_context("spawn").Pool(options.workers, maxtasksperchild=1) as pool:
        for number, checks, broken in pool.imap_unordered(Job.run, jobs, chunksize=1):
            counts += checks
            summary = f"process {number}: {sum(checks.values())} checks, {len(broken)} broken {broken}"
            print(f"{summary}, {time.monotonic() - began:.0f} s", file=sys.stderr, flush=True)
    figures = summarise(counts)
    if options.out:
        options.out.write_text(json.dumps(figures, indent=1) + "\n")
    total: Counter[tuple[str, bool]] = Counter()
    for (_, kind, held), count in counts.items():
        total[kind, held] += count
    verdicts = total["verdict", True] + total["verdict", False]
    sys.exit(int(total["verdict", True] < HOLDS * verdicts or total["witness", False] > 0))


def summarise(counts: Counter[tuple[str, str, bool]]) -> list[dict[str, str | int | float]]:
    """One row per corpus and kind of check; also printed."""
    rows: list[dict[str, str | int | float]] = []
    for name, kind in sorted({key[:2] for key in counts}):
        held = counts[name, kind, True]
        of = held + counts[name, kind, False]
        low, high = wilson(held, of)
        rows.append({"corpus": name, "kind": kind, "held": held, "of": of, "low": low, "high": high})
        print(f"{name:16}{kind:12}{held:6} of {of:6} = {held / of:7.2%} ({low:.2%}-{high:.2%})")
    return rows


if __name__ == "__main__":
    main()
