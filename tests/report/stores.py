"""Stores with planted failures, and films without a simulator."""

import io
from dataclasses import replace
from pathlib import Path

import imageio.v3 as imageio
import numpy as np

from tests.doubles import begun, ended, manifest, passed
from tests.failures.triage.planted import CONDITIONS, SPACE, Planted
from tests.failures.triage.runners import PlantedRunner
from vlafuzz.failures.triage.pipeline import triage
from vlafuzz.model import Actions, Scene
from vlafuzz.report.sources import view_of_store
from vlafuzz.report.view import View
from vlafuzz.store.records import Manifest
from vlafuzz.store.store import Store
from vlafuzz.worlds.evaluator import Film

PLANTED = {name: CONDITIONS[name][0] for name in ("camera-orientation", "light")}
MANIFEST = manifest(operators=SPACE.operators.conditions["operators"])


def store(path: Path, *, findings: int = 3, triaged: int | None = None, policy: str = "idle") -> Path:
    """``findings`` findings of each planted policy, of which the first ``triaged`` (or all) are triaged."""
    with Store.open(path, "write") as opened:
        for seed, condition in enumerate(PLANTED.values()):
            failing = (ended(Planted([condition]).finding(number), proposal=number) for number in range(findings))
            usual = ended(SPACE.nominal(), passed(), findings)
            run = begun(opened, *failing, usual, about=replace(MANIFEST, seed=seed, policy=policy))
            opened.finish(run, "finished", 12.0)
        if triaged != 0:
            conditions = list(PLANTED.values())
            triage(opened, lambda run: PlantedRunner([conditions[run.manifest.seed]]), limit=triaged)
    return path


def view(path: Path) -> View:
    with Store.open(path) as store:
        return view_of_store(store)


class MadeUpFilms:
    """The same grey film for every request; the policy fails where something is not nominal.

    In the first ``passing`` such scenes it passes.
    """

    def __init__(self, passing: int = 0) -> None:
        self.requests: list[tuple[Manifest, Scene, Actions | None]] = []
        self._passing = passing
        frames = np.stack([np.full((64, 64, 3), 9 * shade, np.uint8) for shade in range(15)])
        video = imageio.imwrite("<bytes>", frames, extension=".mp4", fps=15, codec="libx264")
        still = io.BytesIO()
        imageio.imwrite(still, frames[3], extension=".jpg")
        self._video, self._still = bytes(video), still.getvalue()

    def __call__(self, run: Manifest, scene: Scene, actions: Actions | None) -> Film:
        self.requests.append((run, scene, actions))
        fails = actions is None and scene != SPACE.nominal(like=scene)
        self._passing -= fails
        failed = fails and self._passing < 0
        stages = () if failed else (("grasp", 4), ("lift", 6), ("success", 9))
        lost = "grasp" if failed else ""
        return Film(
            self._video,
            self._still,
            failed,
            frames=15,
            moment=3 if failed else 9,
            stages=stages,
            lost=lost,
            size=(64, 64),
            paths=((0, ((9, 9), (30 + 9 * failed, 40))), (8, ((12, 9), (33 + 9 * failed, 40)))),
        )
