"""What a store tells a run before it begins."""

from dataclasses import replace
from pathlib import Path

import pytest

from tests.doubles import manifest
from tests.failures.triage.planted import DARK, SPACE, TILTED
from tests.failures.triage.runners import PlantedEvaluator
from vlafuzz.campaign.causes import causes_like
from vlafuzz.campaign.config import RunConfig, plan
from vlafuzz.campaign.fuzz import Campaign
from vlafuzz.errors import StoreError, UsageError
from vlafuzz.rollouts.executor import LocalExecutor
from vlafuzz.search.causes.strategy import Causes
from vlafuzz.store.store import Store
from vlafuzz.worlds import world_of

FAULTS = [lambda scene: DARK(scene) or TILTED(scene)]


@pytest.fixture(scope="module")
def old(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The store of a run that found causes."""
    path = tmp_path_factory.mktemp("old") / "old.db"
    with Store.open(path, "write") as store:
        Campaign(
            manifest=replace(manifest(strategy="causes", budget=100, batch=4), **SPACE.conditions),
            space=SPACE,
            strategy=Causes(SPACE, 0, 100),
            executor=LocalExecutor(PlantedEvaluator(FAULTS)),
            store=store,
        ).run()
    return path


def test_it_tells_the_listed_causes_with_their_scenes(old: Path):
    like = causes_like(old, SPACE)
    with Store.open(old) as store:
        found = store.causes(1)
    assert found is not None
    assert [cause.operators for cause in like] == [cause.operators for cause in found.causes]
    assert {DARK(SPACE.decode(cause.genome)) for cause in like if cause.operators == ("light",)} == {True}


def test_scenes_of_another_task_keep_what_both_tasks_have(old: Path):
    other = world_of("put-on").space(task="put-on", robot="panda")
    (cause,) = [cause for cause in causes_like(old, other) if cause.operators == ("light",)]
    scene = other.decode(cause.genome)
    assert DARK(scene)
    assert scene.task == "put-on"
    assert replace(scene, light=other.nominal().light) == other.nominal()


def test_a_store_without_a_run_and_one_that_is_missing_are_refused(tmp_path: Path):
    Store.open(tmp_path / "empty.db", "write").close()
    with pytest.raises(UsageError, match="has no run in the world of pick-up"):
        causes_like(tmp_path / "empty.db", SPACE)
    with pytest.raises(StoreError):
        causes_like(tmp_path / "none.db", SPACE)


def test_strategies_that_learn_nothing_from_it_are_refused(old: Path, tmp_path: Path):
    asked = RunConfig(policy="frozen", task="pick-up", strategy="random", like=old, store=tmp_path / "new.db")
    with pytest.raises(UsageError, match="strategy 'random' learns nothing from it"):
        plan(asked)
