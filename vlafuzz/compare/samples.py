"""Samples of a strategy's failures: which of them the expert solves, and what triage says of them."""

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import NamedTuple

import numpy as np

from vlafuzz.compare.failures import CountedRun
from vlafuzz.conditions.conditions import Role
from vlafuzz.scene import Scene
from vlafuzz.statistics import share_interval
from vlafuzz.store.records import Finding, Manifest, Triaged
from vlafuzz.store.store import Store
from vlafuzz.triage.triager import SceneRunner
from vlafuzz.triage.witness import find_witness


class Sampled(NamedTuple):
    """A failing scene, and the run in which it failed."""

    scene: Scene
    run: int


@dataclass(frozen=True)
class Solvable:
    """How many failures of a sample the expert solves, with the 95 % interval of the share over the runs."""

    solved: int
    of: int
    low: float
    high: float


def sample(runs: Sequence[CountedRun], size: int) -> list[Sampled]:
    """At most ``size`` failing scenes of a strategy: the first of every run, then the second, and so on."""
    dealt: dict[Scene, Sampled] = {}
    for round_ in zip_longest(*map(_shuffled, runs)):
        for sampled in filter(None, round_):
            dealt.setdefault(sampled.scene, sampled)
    return list(dealt.values())[:size]


def _shuffled(counted: CountedRun) -> list[Sampled]:
    failures, seed = counted.failures, counted.run.manifest.seed
    order = np.random.default_rng([seed, len(failures)]).permutation(len(failures))
    return [Sampled(failures[index].scene, counted.run.id) for index in order]


def solvable(sampled: Sequence[Sampled], solved: Mapping[str, bool]) -> Solvable | None:
    """The share of a sample that the expert solves, by digest in ``solved``; None for an empty sample."""
    if not sampled:
        return None
    cases = [(failure.run, solved[failure.scene.digest]) for failure in sampled]
    return Solvable(sum(positive for _, positive in cases), len(cases), *share_interval(cases))


class Witnesses:
    """Whether the expert solves scenes, by digest in ``solved``.

    A file of JSON lines keeps it, so that no scene is tried twice under the conditions of a manifest.
    """

    def __init__(self, path: Path, manifest: Manifest) -> None:
        self._path = path
        self._conditions = json.dumps(list(manifest.values(Role.SIMULATION).values()))
        self.solved: dict[str, bool] = {}
        with suppress(FileNotFoundError):
            for line in path.read_text(encoding="utf-8").splitlines():
                self._take(line)

    def missing(self, scenes: Sequence[Scene]) -> list[Scene]:
        """The distinct scenes that were not tried yet."""
        return [scene for scene in dict.fromkeys(scenes) if scene.digest not in self.solved]

    def find(self, scenes: Sequence[Scene], runner: SceneRunner, watch: Callable[[int, int], None]) -> None:
        """Try what is missing; every result is stored at once, and ``watch`` told how many of how many."""
        todo = self.missing(scenes)
        for done, scene in enumerate(todo):
            watch(done, len(todo))
            search = find_witness(scene, runner.solve, runner.play)
            solved = self.solved[scene.digest] = search.witness is not None
            if search.broken:
                continue  # counts as not solved, and is tried again next time
            entry = {"scene": scene.digest, "solved": solved, "conditions": self._conditions}
            with self._path.open("a", encoding="utf-8") as file:
                file.write(json.dumps(entry) + "\n")

    def _take(self, line: str) -> None:
        try:
            entry = json.loads(line)
            if entry["conditions"] == self._conditions:
                self.solved[entry["scene"]] = bool(entry["solved"])
        except (ValueError, KeyError, TypeError):  # the last line of a process that was killed
            return


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """The triage results of a sample of failures.

    Attributes:
        triaged: failures of the sample that could be judged.
        confirmed: failed again; ``low`` and ``high`` are the 95 % interval of their share over the runs.
        witnessed: of these, solved by the expert.
        minimal: of these, those in which every remaining operator is necessary.
        signatures: distinct bugs, without those that fail at nominal.
    """

    triaged: int
    confirmed: int
    low: float
    high: float
    witnessed: int
    minimal: int
    signatures: int


def choose(sampled: Sequence[Sampled], solved: Mapping[str, bool], size: int) -> list[Sampled]:
    """At most ``size`` failures of a sample, those that the expert solves first: only these are shrunk."""
    return sorted(sampled, key=lambda failure: not solved.get(failure.scene.digest))[:size]


def findings(store: Store, chosen: Sequence[Sampled]) -> dict[Sampled, Finding]:
    """The stored findings of some failures, which other runs may have found first."""
    runs = {failure.run for failure in chosen}
    known = {Sampled(finding.scene, run): finding for run in runs for finding in store.findings(run)}
    return {failure: known[failure] for failure in chosen}


def evidence(chosen: Mapping[Sampled, Finding], triaged: Iterable[Triaged]) -> Evidence | None:
    """The triage results of some findings; None if none of them was judged."""
    by_key = {result.key: result for result in triaged}
    runs = [(failure.run, by_key.get(finding.key)) for failure, finding in chosen.items()]
    judged = [result for _, result in runs if result]
    if not judged:
        return None
    confirmed = [(run, result.bucket != "flaky") for run, result in runs if result]
    bugs = {result.signature for result in judged if result.signature and result.bucket != "base"}
    low, high = share_interval(confirmed)
    return Evidence(
        triaged=len(judged),
        confirmed=sum(positive for _, positive in confirmed),
        low=low,
        high=high,
        witnessed=sum(result.witness is not None for result in judged),
        minimal=sum(result.bucket == "minimal" for result in judged),
        signatures=len(bugs),
    )
