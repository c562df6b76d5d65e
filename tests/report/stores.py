"""Stores with planted failures, and films that nobody had to shoot."""

import io
from pathlib import Path

import imageio.v3 as imageio
import numpy as np

from tests.doubles import failed, manifest, passed
from tests.triage.desks import PlantedDesk
from tests.triage.planted import CONDITIONS, SPACE, Planted
from vlafuzz.corpus.ranges import operators_json
from vlafuzz.corpus.records import Manifest, Trial
from vlafuzz.corpus.store import Corpus
from vlafuzz.evidence import Actions
from vlafuzz.findings import triage
from vlafuzz.report.store import view_of_store
from vlafuzz.report.view import Film, View
from vlafuzz.scene import Scene

PLANTED = {name: CONDITIONS[name][0] for name in ("camera-orientation", "light")}
MANIFEST = manifest(operators=operators_json(SPACE.operators))


def store(path: Path, *, findings: int = 3, triaged: int | None = None, subject: str = "idle") -> Path:
    """Of each planted subject so many findings, the first one of those is triaged where asked for."""
    with Corpus.open(path, "write") as corpus:
        for seed, condition in enumerate(PLANTED.values()):
            run = corpus.begin(manifest(operators=MANIFEST.operators, seed=seed, subject=subject))
            planted = Planted([condition])
            for number in range(findings):
                cell = "grasp|light|x0y0"
                corpus.add(run, Trial(number, planted.finding(number), failed(), 1.0, cell=cell))
            corpus.add(run, Trial(findings, SPACE.nominal(), passed(), 0.0))
            corpus.finish(run, "finished", 12.0)
        if triaged != 0:
            conditions = list(PLANTED.values())
            triage(corpus, lambda run: PlantedDesk([conditions[run.manifest.seed]]), limit=triaged)
    return path


def view(path: Path) -> View:
    with Corpus.open(path) as corpus:
        return view_of_store(corpus)


class MadeUpFilms:
    """A grey film for everything; ``asked`` says of what. The subject passes in ``passing``."""

    def __init__(self, passing: int = 0) -> None:
        self.asked: list[tuple[Manifest, Scene, Actions | None]] = []
        self._passing = passing
        frames = np.stack([np.full((64, 64, 3), 9 * shade, np.uint8) for shade in range(15)])
        video = imageio.imwrite("<bytes>", frames, extension=".mp4", fps=15, codec="libx264")
        still = io.BytesIO()
        imageio.imwrite(still, frames[3], extension=".jpg")
        self._video, self._still = bytes(video), still.getvalue()

    def __call__(self, run: Manifest, scene: Scene, actions: Actions | None) -> Film:
        self.asked.append((run, scene, actions))
        subjects = sum(actions is None for _, _, actions in self.asked)
        return Film(self._video, self._still, actions is None and subjects > self._passing)
