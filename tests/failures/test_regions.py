"""The share that a certified cause's row tells is of the range that it prints."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from tests.doubles import ended, failed, manifest, passed
from tests.failures.triage.planted import SPACE
from tests.failures.triage.runners import PlantedRunner
from vlafuzz.failures.causes import causes_of
from vlafuzz.failures.triage.pipeline import cause_findings, triage
from vlafuzz.model import Scene
from vlafuzz.store.records import Attribution, FoundCause
from vlafuzz.store.store import Store

NOMINAL = SPACE.nominal()
FAULTS = {
    "light": lambda scene: scene.light.intensity > 5,
    "camera-orientation": lambda scene: scene.camera.pitch > 3.2,
    "target-position": lambda scene: scene.targets[0].y < -0.15,
}
SHOWN = {
    "light": replace(NOMINAL, light=replace(NOMINAL.light, intensity=8.0)),
    "camera-orientation": replace(NOMINAL, camera=replace(NOMINAL.camera, pitch=4.5)),
    "target-position": replace(NOMINAL, targets=(replace(NOMINAL.targets[0], y=-0.2),)),
}


def breaks(scene: Scene) -> bool:
    return any(fault(scene) for fault in FAULTS.values())


def test_shares_of_certified_causes_are_those_of_their_ranges(tmp_path: Path):
    rng = np.random.default_rng(0)
    scenes = [*SHOWN.values(), *(SPACE.sample(rng) for _ in range(150))]
    with Store.open(tmp_path / "a.db", "write") as store:
        store.begin(manifest(strategy="causes", **SPACE.conditions))
        for proposal, scene in enumerate(scenes):
            store.add(1, ended(scene, failed() if breaks(scene) else passed(), proposal))
        found = tuple(FoundCause(scene, (name,), 1) for name, scene in SHOWN.items())
        store.keep_causes(1, Attribution(found, at_random=tuple(range(len(SHOWN), len(scenes)))))
        triage(store, lambda run: PlantedRunner([breaks]), findings=cause_findings(store, 1))
        listed = causes_of(store, store.runs()[0])
    drawn = [SPACE.sample(np.random.default_rng([11, number])) for number in range(1500)]
    owners = [[name for name, fault in FAULTS.items() if fault(scene)] for scene in drawn]
    assert [cause.bucket for cause in listed.causes] == ["minimal"] * 3
    for cause in listed.causes:
        (name,) = {name for name in FAULTS if cause.conditions[0].startswith(name)}
        true = np.mean([(name in owned) / max(len(owned), 1) for owned in owners])
        assert cause.share.low - 0.01 <= true <= cause.share.high + 0.01  # the truth is an estimate itself
        assert abs(cause.share.value - true) < 0.05
    explained = sum(cause.share.value for cause in listed.causes)
    assert abs(explained - np.mean([bool(owned) for owned in owners])) < 0.08
