"""The share that a certified cause's row tells is of the range that it prints."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tests.doubles import STAGES, failed, manifest, passed
from tests.failures.triage.planted import SPACE
from tests.failures.triage.runners import PlantedRunner
from vlafuzz.campaign.fuzz import fuzz
from vlafuzz.failures.causes import causes_of
from vlafuzz.failures.triage.pipeline import certify_causes
from vlafuzz.model.outcome import Outcome
from vlafuzz.model.scene import Scene
from vlafuzz.rollouts.executor import LocalExecutor
from vlafuzz.search.causes.strategy import Causes
from vlafuzz.store.store import Store

FAULTS = {
    "light": lambda scene: scene.light.intensity > 5,
    "camera-orientation": lambda scene: scene.camera.pitch > 3.2,
    "target-position": lambda scene: scene.targets[0].y < -0.15,
}


def breaks(scene: Scene) -> bool:
    return any(fault(scene) for fault in FAULTS.values())


class Judge:
    """Fails where one of the faults is."""

    def evaluate(self, scenes: Sequence[Scene]) -> list[Outcome]:
        return [failed() if breaks(scene) else passed() for scene in scenes]

    def close(self) -> None:
        """Nothing is kept."""


def test_shares_of_certified_causes_are_those_of_their_ranges(tmp_path: Path):
    told = manifest(budget=260, seed=3, strategy="causes", **SPACE.conditions)
    with Store.open(tmp_path / "a.db", "write") as store:
        strategy, executor = Causes(SPACE, 3, 260), LocalExecutor(Judge())
        fuzz(manifest=told, stages=STAGES, space=SPACE, strategy=strategy, executor=executor, store=store)
        certify_causes(store, lambda run: PlantedRunner([breaks]), 1)
        listed = causes_of(store, store.runs()[0])
    scenes = [SPACE.sample(np.random.default_rng([11, number])) for number in range(1500)]
    owners = [[name for name, fault in FAULTS.items() if fault(scene)] for scene in scenes]
    certified = [cause for cause in listed.causes if cause.bucket == "minimal"]
    assert len(certified) >= 2
    for cause in certified:
        (name,) = {name for name in FAULTS if cause.conditions[0].startswith(name)}
        true = np.mean([(name in owned) / max(len(owned), 1) for owned in owners])
        assert cause.share.low - 0.01 <= true <= cause.share.high + 0.01  # the truth is an estimate itself
        assert abs(cause.share.value - true) < 0.05
    explained = sum(cause.share.value for cause in certified)
    assert abs(explained - np.mean([bool(owned) for owned in owners])) < 0.08
