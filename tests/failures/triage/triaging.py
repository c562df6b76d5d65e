"""A store of findings, and triage of them with a policy whose faults are planted."""

from collections.abc import Sequence

from tests.doubles import failed, manifest
from tests.failures.triage.planted import CONDITIONS, SPACE, Condition, Planted
from tests.failures.triage.runners import PlantedRunner
from vlafuzz.failures.triage.pipeline import triage
from vlafuzz.model.scene import Scene
from vlafuzz.store.records import Triaged, Trial
from vlafuzz.store.store import Store

TILTED, DARK = CONDITIONS["camera-orientation"][0], CONDITIONS["light"][0]


def scenes(conditions: Sequence[Condition], number: int) -> list[Scene]:
    return [Planted(conditions).finding(seed) for seed in range(number)]


def fill(store: Store, failing: Sequence[Scene], cells: Sequence[str] = ()) -> Store:
    """A run in which these scenes fail, each in a cell of its own unless cells are given."""
    run = store.begin(manifest())
    for proposal, scene in enumerate(failing):
        cell = cells[proposal] if cells else f"cell {proposal}"
        trial = Trial(proposal=proposal, scene=scene, outcome=failed(), severity=SPACE.severity(scene), cell=cell)
        store.add(run, trial)
    return store


def triaged(store: Store, runner: PlantedRunner, **options: int) -> list[Triaged]:
    triage(store, lambda run: runner, **options)
    return store.triaged()
