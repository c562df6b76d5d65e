"""Which scenes are demonstrated: those of failures, without the causes that are held out, or random ones."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from vlafuzz.errors import CorpusError, StoreError, UsageError
from vlafuzz.failures.corpus.corpus import Corpus
from vlafuzz.model.scene import Scene
from vlafuzz.model.space import Space
from vlafuzz.store.records import Manifest
from vlafuzz.store.store import Store
from vlafuzz.worlds import world_of

Which = Literal["failed", "minimal", "random"]
DEMONSTRATE = 300_000_000  # numbers of jitters and draws from here on; see ``failures.corpus.controls``


@dataclass(frozen=True, eq=False)
class Failure:
    """A failing scene, and those that are demonstrated for it.

    Attributes:
        scenes: the failing scene alone; or the minimal one with its passing counterparts.
        cause: what failures of one cause have in common: a signature, or the cell where none of it is triaged.
    """

    scene: Scene
    run: Manifest
    scenes: tuple[Scene, ...]
    cause: str


class Wanted(NamedTuple):
    """A scene to be demonstrated, the expert's first attempt there, and the digest of the failing scene."""

    scene: Scene
    run: Manifest
    attempt: int
    finding: str


def failures_of_store(store: Store, run: int | None, which: Which) -> list[Failure]:
    """The findings of a store; for ``minimal`` those that triage has made minimal.

    Raises:
        StoreError: there is none.
    """
    manifests = {begun.id: begun.manifest for begun in store.runs()}
    triaged = {row.key: row for row in store.triaged()}
    findings = {finding: f"{finding.scene.task}|{finding.cell}" for finding in store.findings(run)}
    signatures = {key: row.signature for key, row in triaged.items() if row.signature}
    by_cell = {cell: signatures[finding.key] for finding, cell in findings.items() if finding.key in signatures}
    failures: dict[Scene, Failure] = {}
    for finding, cell in findings.items():
        row, cause = triaged.get(finding.key), signatures.get(finding.key) or by_cell.get(cell, cell)
        scenes: tuple[Scene, ...] = (finding.scene,)
        if which == "minimal":
            if row is None or row.bucket != "minimal" or row.shrunk is None:
                continue
            scenes = (row.shrunk, *row.counterparts.values())
        failures.setdefault(finding.scene, Failure(finding.scene, manifests[finding.run], scenes, cause))
    if not failures and which == "minimal":
        raise StoreError(f"{store.path}: has no minimal finding", hint="`vlafuzz triage` makes them")
    if not failures:
        raise StoreError(f"{store.path}: has no failing scene", hint="`vlafuzz run` looks for some")
    return list(failures.values())


def failures_of_corpus(folder: Path, corpus: Corpus, which: Which) -> list[Failure]:
    """The cases of a corpus."""
    if not corpus.cases:
        raise CorpusError(f"{folder}: has no failing scene", hint="`vlafuzz export --minimal` writes some")
    return [
        Failure(
            case.scene,
            corpus.runs[case.run],
            (case.scene, *(case.counterparts.values() if which == "minimal" else ())),
            case.signature,
        )
        for case in corpus.cases
    ]


def split(source: Path, failures: Sequence[Failure], share: float) -> tuple[list[Failure], list[Failure]]:
    """The failures to be demonstrated, and about that share of them that is held out.

    Failures of one cause are on one side. ``source`` is for messages.

    Raises:
        UsageError: they are all of one cause.
    """
    if share == 0:
        return list(failures), []
    by_cause = defaultdict[str, list[Failure]](list)
    for failure in failures:
        by_cause[failure.cause].append(failure)
    groups = list(by_cause.values())
    wanted, out = share * len(failures), list[Failure]()
    if len(groups) < 2:
        problem = f"{source}: its {len(failures)} failures have one cause"
        hint = "leave out --hold-out, and try the trained policy in random scenes with another --seed"
        raise UsageError(problem, hint)
    for number in np.random.default_rng(len(failures)).permutation(len(groups)):
        group = groups[number]
        if abs(len(out) + len(group) - wanted) < abs(len(out) - wanted):
            out += group
    if not out or len(out) == len(failures):  # few large groups: the smallest one
        out = min(groups, key=len)
    held = {failure.scene for failure in out}
    return [failure for failure in failures if failure.scene not in held], out


def _space_of(run: Manifest) -> tuple[str, ...]:
    return run.task, run.robot, run.operators_digest, run.packs


def _spaces(source: Path, runs: Iterable[Manifest]) -> dict[tuple[str, ...], Space]:
    distinct = {_space_of(run): run for run in runs}
    return {kind: world_of(run.task).stored_space(source, run) for kind, run in distinct.items()}


def around(source: Path, failures: Iterable[Failure]) -> Iterator[Wanted]:
    """Every scene as it is, then each again and again, slightly jittered, with another first attempt."""
    scenes = [(scene, failure) for failure in failures for scene in failure.scenes]
    spaces: Mapping[tuple[str, ...], Space] = {}
    for number in count():
        for scene, failure in scenes:
            shown = scene
            if number:
                spaces = spaces or _spaces(source, (failure.run for _, failure in scenes))
                shown = spaces[_space_of(failure.run)].jittered(scene, DEMONSTRATE + number)
            yield Wanted(shown, failure.run, number, failure.scene.digest)


def at_random(source: Path, failures: Sequence[Failure]) -> Iterator[Wanted]:
    """Random scenes under the conditions of the failures' runs in turn, with the same first attempts."""
    runs = [failure.run for failure in failures]
    spaces = _spaces(source, runs)
    for number in count():
        run = runs[number % len(runs)]
        scene = spaces[_space_of(run)].sample(np.random.default_rng([run.seed, DEMONSTRATE + number]))
        yield Wanted(scene, run, number // len(runs), "")
