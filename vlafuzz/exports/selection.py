"""Which scenes are demonstrated: those of failures, without the causes that are held out, or random ones."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vlafuzz.errors import CorpusError, StoreError, UsageError
from vlafuzz.failures.corpus.corpus import Corpus
from vlafuzz.model.scene import Scene
from vlafuzz.model.space import Space
from vlafuzz.store.records import Manifest
from vlafuzz.store.store import Store
from vlafuzz.worlds import world_of

Which = Literal["failed", "minimal", "random"]
DEMONSTRATE = 300_000_000  # numbers of jitters and draws from here on; see ``regression.controls``
# Two scenes that differ in one operator only are at most 1 apart. Nudging every gene by 2 % of its range
# moves a scene by less than 0.1, another object in one slot by 0.5 or more; and of 180,000 pairs of random
# scenes none was nearer than 0.3.
RADIUS = 0.2


@dataclass(frozen=True, eq=False)
class Failure:
    """A failing scene, and those that are demonstrated for it.

    Attributes:
        scenes: the failing scene alone; or the minimal one with its passing counterparts.
        causes: what it has in common with failures of the same cause: its cell, or its signature.
    """

    scene: Scene
    run: Manifest
    scenes: tuple[Scene, ...]
    causes: tuple[str, ...]


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
    failures: dict[Scene, Failure] = {}
    for finding in store.findings(run):
        row = triaged.get(finding.key)
        signed = (row.signature,) if row and row.signature else ()
        scenes: tuple[Scene, ...] = (finding.scene,)
        if which == "minimal":
            if row is None or row.bucket != "minimal" or row.shrunk is None:
                continue
            scenes = (row.shrunk, *row.counterparts.values())
        cell = f"{finding.scene.task}|{finding.cell}"
        found = Failure(finding.scene, manifests[finding.run], scenes, (cell, *signed))
        failures.setdefault(finding.scene, found)
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
            (case.signature,),
        )
        for case in corpus.cases
    ]


def split(source: Path, failures: Sequence[Failure], share: float) -> tuple[list[Failure], list[Failure]]:
    """The failures to be demonstrated, and about that share of them that is held out.

    Failures of one cause, and those that are nearly the same scene, are on one side. ``source`` is for messages.

    Raises:
        UsageError: they are all of one cause.
    """
    if share == 0:
        return list(failures), []
    groups = _groups(source, failures)
    wanted, out = share * len(failures), list[Failure]()
    if len(groups) < 2:
        problem = f"{source}: its {len(failures)} failures have one cause or neighbourhood"
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


def _groups(source: Path, failures: Sequence[Failure]) -> list[list[Failure]]:
    """Failures that are connected by a cause or a neighbourhood."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    labels: dict[Scene, list[Hashable]] = {each.scene: list(each.causes) for each in failures}
    spaces = _spaces(source, (each.run for each in failures))
    for kind, space in spaces.items():
        scenes = (each.scene for each in failures if _space_of(each.run) == kind)
        for scene, near in neighbourhoods(scenes, space.embed).items():
            labels[scene].append((kind, near))
    nodes = {label: len(failures) + number for number, label in enumerate(set().union(*labels.values()))}
    edges = [(index, nodes[label]) for index, each in enumerate(failures) for label in labels[each.scene]]
    size = len(failures) + len(nodes)
    graph = coo_array((np.ones(len(edges)), np.transpose(edges)), shape=(size, size))
    _, component = connected_components(graph, directed=False)
    groups: dict[int, list[Failure]] = {}
    for failure, number in zip(failures, component, strict=False):
        groups.setdefault(int(number), []).append(failure)
    return list(groups.values())


def neighbourhoods(scenes: Iterable[Scene], embed: Callable[[Scene], NDArray[np.float64]]) -> dict[Scene, int]:
    """The number of each scene's group of near-duplicates; a chain of small steps is not one group."""
    from sklearn.cluster import Birch

    ordered = sorted(set(scenes), key=lambda scene: scene.digest)  # so that the order of scenes does not matter
    if not ordered:
        return {}
    # a tree of one level, in which a scene joins the nearest group
    birch = Birch(threshold=RADIUS, n_clusters=None, branching_factor=len(ordered) + 1)
    labels = birch.fit_predict(np.stack([embed(scene) for scene in ordered]))
    return dict(zip(ordered, map(int, labels), strict=True))


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
