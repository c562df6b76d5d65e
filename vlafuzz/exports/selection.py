"""Which scenes are exported; and which are demonstrated: of failures, or random ones."""

from collections.abc import Iterator, Sequence
from itertools import count
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from vlafuzz.errors import StoreError, UsageError
from vlafuzz.failures.corpus.folder import is_corpus, read_corpus
from vlafuzz.failures.described import space_of
from vlafuzz.model import Scene
from vlafuzz.store.records import Manifest
from vlafuzz.store.store import Store

Which = Literal["failed", "random"]
DEMONSTRATE = 300_000_000  # numbers of jitters and draws from here on; see ``failures.corpus.controls``


def scenes_of(source: Path, run: int | None = None) -> list[Scene]:
    """The distinct scenes of a store that failed."""
    with Store.open(source) as store:
        return list(dict.fromkeys(finding.scene for finding in store.findings(run)))


class FailingScene(NamedTuple):
    """A failing scene of a run."""

    scene: Scene
    run: Manifest


class WantedScene(NamedTuple):
    """A scene to be demonstrated, the expert's first attempt there, and the digest of the failing scene."""

    scene: Scene
    run: Manifest
    attempt: int
    finding: str


def failures_of(source: Path, run: int | None = None) -> list[FailingScene]:
    """The cases of a corpus, or the findings of a store.

    Raises:
        StoreError: there is none.
        UsageError: a run is named, and the source is a corpus.
    """
    if not is_corpus(source):
        with Store.open(source) as store:
            return _findings(store, run)
    if run is not None:
        raise UsageError(f"--run {run}: {source} is a corpus, not a store", hint="leave out --run")
    corpus = read_corpus(source)
    return [FailingScene(case.scene, corpus.runs[case.run]) for case in corpus.cases]


def _findings(store: Store, run: int | None) -> list[FailingScene]:
    manifests = {begun.id: begun.manifest for begun in store.runs()}
    failures: dict[Scene, FailingScene] = {}
    for finding in store.findings(run):
        failures.setdefault(finding.scene, FailingScene(finding.scene, manifests[finding.run]))
    if not failures:
        raise StoreError(f"{store.path}: has no failing scene", hint="`vlafuzz run` looks for some")
    return list(failures.values())


def around(source: Path, failures: Sequence[FailingScene]) -> Iterator[WantedScene]:
    """Every scene as it is, then each again and again, slightly jittered, with another first attempt."""
    for number in count():
        for scene, run in ((failure.scene, failure.run) for failure in failures):
            shown = space_of(source, run).jittered(scene, DEMONSTRATE + number) if number else scene
            yield WantedScene(shown, run, number, scene.digest)


def at_random(source: Path, failures: Sequence[FailingScene]) -> Iterator[WantedScene]:
    """Random scenes under the conditions of the failures' runs in turn, with the same first attempts."""
    for number in count():
        run = failures[number % len(failures)].run
        scene = space_of(source, run).sample(np.random.default_rng([run.seed, DEMONSTRATE + number]))
        yield WantedScene(scene, run, number // len(failures), "")
