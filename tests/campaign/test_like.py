"""What a store tells a run before it begins."""

from dataclasses import replace
from pathlib import Path

import pytest

from tests.campaign.test_causes import DARK, FAULTS
from tests.doubles import STAGES, manifest
from tests.failures.triage.planted import SPACE
from tests.failures.triage.runners import PlantedEvaluator
from vlafuzz.campaign.config import RunConfig, plan
from vlafuzz.campaign.fuzz import fuzz
from vlafuzz.campaign.like import predecessor_of
from vlafuzz.errors import StoreError, UsageError
from vlafuzz.rollouts.executor import LocalExecutor
from vlafuzz.search.causes.strategy import Causes
from vlafuzz.store.store import Store
from vlafuzz.worlds import world_of
from vlafuzz.worlds.base import Wanted


@pytest.fixture(scope="module")
def old(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The store of a run that found causes."""
    path = tmp_path_factory.mktemp("old") / "old.db"
    with Store.open(path, "write") as store:
        fuzz(
            manifest=replace(manifest(strategy="causes", budget=100, batch=4), **SPACE.conditions),
            stages=STAGES,
            space=SPACE,
            strategy=Causes(SPACE, 0, 100),
            executor=LocalExecutor(PlantedEvaluator(FAULTS)),
            store=store,
        )
    return path


def test_it_tells_the_listed_causes_with_their_scenes_and_all_outcomes(old: Path):
    like = predecessor_of(old, SPACE)
    with Store.open(old) as store:
        found, judged = store.causes(1), store.outcomes_by_scene(1)
    assert found is not None
    assert [operators for _, operators in like.causes] == [cause.operators for cause in found.causes]
    assert {DARK(SPACE.decode(genome)) for genome, operators in like.causes if operators == ("light",)} == {True}
    assert (len(like.genomes), like.failed.sum()) == (len(judged), sum(failed for _, failed in judged))


def test_scenes_of_another_task_keep_what_both_tasks_have(old: Path):
    other = world_of("put-on").space(Wanted(task="put-on", robot="panda"))
    ((genome, _),) = [pair for pair in predecessor_of(old, other).causes if pair[1] == ("light",)]
    scene = other.decode(genome)
    assert DARK(scene)
    assert scene.task == "put-on"
    assert replace(scene, light=other.nominal().light) == other.nominal()


def test_a_store_without_a_run_and_one_that_is_missing_are_refused(tmp_path: Path):
    Store.open(tmp_path / "empty.db", "write").close()
    with pytest.raises(UsageError, match="has no run in the world of pick-up"):
        predecessor_of(tmp_path / "empty.db", SPACE)
    with pytest.raises(StoreError):
        predecessor_of(tmp_path / "none.db", SPACE)


def test_strategies_that_learn_nothing_from_it_are_refused(old: Path, tmp_path: Path):
    asked = RunConfig(policy="frozen", task="pick-up", strategy="random", like=old, store=tmp_path / "new.db")
    with pytest.raises(UsageError, match="strategy 'random' learns nothing from it"):
        plan(asked)
