#!/usr/bin/env python
"""Lists of causes and certificates in worlds with planted faults, by how often the policy fails by chance.

Without physics. A row of a list is true if resetting any one of its operators lowers the true failure rate by at least
20 points. Seeds from 100 on are for tuning; figures are reported for those below.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path
from statistics import median
from typing import NamedTuple

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # tests/search/toy.py

from strategies.faults import Density, World, space_of, world
from strategies.search import Tried, search
from strategies.triaged import Runner, cells_first

from vlafuzz.campaign.config import FURTHER, LEAST
from vlafuzz.common.statistics import Share
from vlafuzz.failures.triage.certify import certified
from vlafuzz.failures.triage.pipeline import known_to
from vlafuzz.failures.triage.triager import Triager
from vlafuzz.model import Scene, Threshold
from vlafuzz.search import registry
from vlafuzz.search.base import Strategy, looks_for_causes, said_by
from vlafuzz.search.scoring import Score
from vlafuzz.store.records import Finding, FoundCause, Repeats, Triaged
from vlafuzz.worlds.tabletop.space import SearchSpace

EFFECT = 0.2  # by which a reset lowers the rate where a row is true
Row = dict[str, float]


class Job(NamedTuple):
    density: Density
    background: float
    seed: int
    options: argparse.Namespace


def run(job: Job) -> Row:
    """Search, then certification of what was found, the commonest first, with as many rollouts as are given."""
    options = job.options
    here = replace(world(job.density, job.seed), background=job.background)
    if options.flat:
        here = replace(here, faults=())
    space = space_of(here.task)
    strategy = registry.strategy_factory(options.strategy)(space, job.seed, options.budget)
    known: dict[str, Score] = {}

    def search_on(rollouts: int) -> list[Tried]:
        return [pair for batch in search(space, here.evaluate, strategy, rollouts, known) for pair in batch]

    tried = search_on(options.budget)
    certifier = Certifier(here, options.certifying)
    if looks_for_causes(strategy):
        certifier.certify(listed(strategy, space), tried)
        if certifier.left >= LEAST and options.further:
            strategy.conclude()  # type: ignore[attr-defined]
            more = search_on(round(FURTHER * certifier.left))
            tried, certifier.left = tried + more, certifier.left - len(more)
            certifier.certify(listed(strategy, space), tried)
    else:
        failing = cells_first([pair for pair in tried if pair[1].failed])
        certifier.certify({scene: FoundCause(scene, (), 1) for scene in failing}, tried)
    scenes = listed(strategy, space)
    true = [is_true(here, scene, cause.operators) for scene, cause in scenes.items()]
    faults = {met[0] for scene in scenes if len(met := here.met(scene)) == 1}
    rows: Row = {"rows": len(scenes), "true": sum(true), "faults": len(faults), "planted": len(here.faults)}
    return rows | certifier.row()


def listed(strategy: Strategy, space: SearchSpace) -> dict[Scene, FoundCause]:
    """Each cause so far by the scene that shows it, the commonest first."""
    causes = sorted(said_by(strategy, "causes", ()), key=lambda cause: -(cause.share.value if cause.share else 0))
    scenes = {space.decode(cause.genome): cause for cause in causes}
    return {
        scene: FoundCause(scene, cause.operators, cause.failures, tests=cause.tests) for scene, cause in scenes.items()
    }


@dataclass
class Certifier:
    """Certifies scenes in turn until no rollouts are ``left``; how many hold, are true, and have a true threshold."""

    here: World
    left: int
    done: list[Triaged] = field(default_factory=list)
    takes: list[int] = field(default_factory=list)
    tried: set[Scene] = field(default_factory=set)
    repeats: Repeats = field(default_factory=dict)

    def certify(self, scenes: Mapping[Scene, FoundCause], tried: Sequence[Tried]) -> None:
        trials = [(scene, judged.failed) for scene, judged in tried]
        for scene in [scene for scene in scenes if scene not in self.tried]:
            if self.left <= 0:
                return
            self.tried.add(scene)
            runner = Runner(self.here)
            runner.deterministic = runner.deterministic and not self.here.background
            known = certified(self.done[: known_to(len(self.done))])
            triager = Triager(runner, trials=trials, blamed=scenes, known=known, repeats=self.repeats)
            triaged = triager.triage(Finding(scene, "", 0, ""))
            if not isinstance(triaged, Triaged):
                continue
            # Those of the nominal scene are shared.
            self.takes.append(sum(one.rollouts for one in self.repeats.values()) - sum(self.takes))
            self.left -= self.takes[-1]
            if triaged.bucket == "minimal" and triaged.shrunk and self.left >= 0:
                self.done.append(triaged)

    def row(self) -> Row:
        here, shown = self.here, [(one, one.shrunk) for one in self.done if one.shrunk]
        true = sum(is_true(here, scene, one.operators) for one, scene in shown)
        distinct = {index for _, scene in shown for index in here.met(scene)}
        located = [
            within for one, scene in shown for each in one.causes.thresholds for within in is_within(here, scene, each)
        ]
        counts = {"certified": len(shown), "certified true": true, "distinct": len(distinct)}
        spent = {"takes": median(self.takes)} if self.takes else {}
        return {**counts, "thresholds": len(located), "thresholds true": sum(located), **spent}


def is_within(here: World, scene: Scene, threshold: Threshold) -> list[bool]:
    """Whether the true threshold lies in the interval, a grid step wider; nothing where there is no single one."""
    space, faults = space_of(here.task), [here.faults[index] for index in here.met(scene)]
    if len(threshold.at) != 1 or len(faults) != 1:
        return []
    ((path, _),), gene = threshold.at, space.by_path[threshold.at[0][0]]
    conditions = [one for one in faults[0].conditions if one.path in (path, path.partition(".")[0]) and not one.options]
    level, start = gene.grid.snap(space.values(scene)[path]), gene.grid.nominal_level
    found = []
    for condition in conditions:
        bound = condition.low if level > start else condition.high
        if math.isfinite(bound):
            true = gene.grid.snap(2**bound if condition.path == "light" else bound)
            low, high = sorted(gene.grid.snap(dict(ends)[path]) for ends in (threshold.low, threshold.high))
            found.append(low - 1 <= true <= high + 1)
    return found


def is_true(here: World, scene: Scene, operators: tuple[str, ...]) -> bool:
    """Whether resetting any one of the operators lowers the true failure rate enough."""
    space, rate = space_of(here.task), here.fails(scene)
    resets = [space.reset(scene, space.groups.get(name, (name,))) for name in operators]
    return all(rate - here.fails(reset) >= EFFECT for reset in resets)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--backgrounds", nargs="+", type=float, default=[0.0, 0.1, 0.2, 0.4])
    parser.add_argument("--densities", nargs="+", default=["dense", "middling", "sparse"])
    parser.add_argument("--strategy", default="causes", help="causes, or one whose failures are triaged")
    parser.add_argument("--flat", action="store_true", help="plant no fault: then nothing should be listed")
    parser.add_argument("--repeats", type=int, default=8, help="worlds of each density")
    parser.add_argument("--seed", type=int, default=100, help="of the first world")
    parser.add_argument("--budget", type=int, default=300, help="rollouts of a run")
    parser.add_argument("--certifying", type=int, default=300, help="rollouts of certification")
    parser.add_argument("--no-further", dest="further", action="store_false", help="certify only what the run found")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--out", type=Path, help="JSON file for the raw results")
    options = parser.parse_args()
    seeds = range(options.seed, options.seed + options.repeats)
    densities = options.densities[:1] if options.flat else options.densities  # without faults all are the same
    several = product(options.backgrounds, densities, seeds)
    jobs = [Job(density, background, seed, options) for background, density, seed in several]
    with ProcessPoolExecutor(options.workers) as pool:
        results = list(zip(jobs, pool.map(run, jobs), strict=True))
    for background in options.backgrounds:
        print(f"background {background:.0%}: {summary([row for job, row in results if job.background == background])}")
    if options.out:
        options.out.write_text(json.dumps([(job[:3], row) for job, row in results]), encoding="utf-8")


def summary(rows: list[Row]) -> str:
    total = {name: int(sum(row[name] for row in rows)) for name in rows[0] if name != "takes"}
    takes = [row["takes"] for row in rows if "takes" in row]
    empty = sum(row["rows"] == 0 for row in rows)
    return (
        f"{len(rows)} runs, {empty} lists empty; rows true {Share.of_counts(total['true'], total['rows'])}; "
        f"{total['faults']} of {total['planted']} faults; certified {total['certified']}, "
        f"{total['certified true']} of them true, {total['distinct']} faults, "
        f"{total['distinct'] / len(rows):.2f} a run; thresholds true {total['thresholds true']} of "
        f"{total['thresholds']}; a cause takes {median(takes) if takes else 0:g} rollouts"
    )


if __name__ == "__main__":
    main()
