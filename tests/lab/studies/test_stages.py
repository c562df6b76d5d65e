"""Shares of scenes that reach each stage, and what confounders like the target change."""

from pathlib import Path

import pytest

from tests.doubles import failed, manifest, passed, rollout, scene
from vlafuzz.errors import UsageError
from vlafuzz.lab.studies.runner import COUNTS, Part, operators_of, stored
from vlafuzz.lab.studies.sheet import adjusted
from vlafuzz.lab.studies.stages import Similarity, StageResult, in_paper, is_similar, similarities, standing
from vlafuzz.lab.studies.study import StudyRequest
from vlafuzz.model.outcome import Outcome
from vlafuzz.model.scene import Placement, Scene
from vlafuzz.store.records import Status, Trial
from vlafuzz.store.store import Store
from vlafuzz.worlds.tabletop.objects import load_catalogue
from vlafuzz.worlds.tabletop.space import SearchSpace, load_operators
from vlafuzz.worlds.tabletop.tasks import TASKS

CATALOGUE = load_catalogue()
STAGES = TASKS["pick-up"].stage_names


def lost_after(*reached: str) -> Outcome:
    return Outcome.of((rollout(0.5, reached),), STAGES)


def run_of(store: Store, *trials: tuple[Scene, Outcome], status: Status = "finished") -> None:
    run = store.begin(manifest())
    for number, (shown, outcome) in enumerate(trials):
        store.add(run, Trial(proposal=number, scene=shown, outcome=outcome, severity=0.0))
    store.finish(run, status, 1.0)


def with_confounder(name: str, x: float) -> Scene:
    beside = Placement(name, CATALOGUE[name].stable_poses[0].name, 0.1, 0.2)
    return Scene("pick-up", scene(x=x).targets, "pick up green cube", confounders=(beside,))


def test_a_stage_counts_where_it_was_reached_and_success_implies_all(tmp_path: Path) -> None:
    outcomes = [passed(), lost_after("grasp"), lost_after("grasp", "lift"), failed()]
    outcomes += [Outcome.invalid("geometry", "too close"), Outcome.error("broke")]
    with Store.open(tmp_path / "a.db", "write") as store:
        run_of(store, *((scene(x=0.001 * number), row) for number, row in enumerate(outcomes)))
        result = standing(store, store.runs()[0])
    assert [(row.stage, row.count, row.of) for row in result.stages] == [
        ("grasp", 3, 4), ("lift", 2, 4), ("success", 1, 4),
    ]  # fmt: skip
    assert (result.judged, result.invalid, result.errors, result.stopped) == (4, 1, 1, False)
    assert result.stages[2].low == pytest.approx(0.0456, abs=1e-4)


@pytest.mark.parametrize(("status", "said"), [("finished", False), ("stopped", True)])
def test_a_run_that_ended_early_is_said(tmp_path: Path, status: Status, said: bool) -> None:
    with Store.open(tmp_path / "a.db", "write") as store:
        run_of(store, (scene(), passed()), status=status)
        result = StageResult("rq1", ["idle"], [], [standing(store, store.runs()[0])], [], [])
    assert ("Ended before all scenes: pick-up, idle." in result.sheet()[1]) is said


def test_of_several_rollouts_all_must_reach_a_stage(tmp_path: Path) -> None:
    mixed = Outcome.of((rollout(), rollout(0.4, ("grasp",))), STAGES)
    with Store.open(tmp_path / "a.db", "write") as store:
        run_of(store, (scene(), mixed))
        result = standing(store, store.runs()[0])
    assert [row.count for row in result.stages] == [1, 0, 0]


def test_the_papers_success_of_a_task() -> None:
    result = in_paper("pick-up")
    assert (result.mean, result.as_well) == (0.124, 0.128)
    assert len(result.policies) == 7
    assert result.policies["rt-1-400k"] == 0.344


def test_like_the_target_is_what_is_called_alike() -> None:
    cans = Placement("coke_can", "standing", 0.0, 0.0), Placement("pepsi_can", "standing", 0.1, 0.1)
    assert is_similar(Scene("pick-up", cans[:1], "", confounders=cans[1:]), CATALOGUE)
    assert not is_similar(
        Scene("pick-up", cans[:1], "", confounders=(Placement("apple", "resting", 0.1, 0.1),)), CATALOGUE
    )


def test_less_progress_beside_what_is_similar_shows(tmp_path: Path) -> None:
    similar = [(with_confounder("yellow_cube", 0.001 * number), failed(0.1)) for number in range(8)]
    others = [(with_confounder("apple", 0.001 * number), failed(0.6)) for number in range(8)]
    with Store.open(tmp_path / "a.db", "write") as store:
        run_of(store, *similar, *others, (scene(), passed()))
        (result,) = similarities(store, store.runs(), CATALOGUE)
    assert (result.similar, result.other, result.a12) == (8, 8, 0.0)
    assert result.p == pytest.approx(2 / 12870)
    alone = Similarity(
        task="put-in", policy="idle", similar=0, other=3, progress_similar=None, progress_other=0.5, a12=None, p=None
    )
    assert [row.adjusted for row in adjusted([result, alone])] == [result.p, None]


def test_rq2_has_every_number_of_confounders_of_every_task() -> None:
    assert StudyRequest("rq1", ["pick-up", "put-in"]).parts() == [Part("pick-up"), Part("put-in")]
    assert StudyRequest("rq2", ["put-on"], ["a"]).parts() == [Part("put-on", count, "a") for count in COUNTS]


@pytest.mark.parametrize("count", COUNTS)
def test_the_operators_of_a_part_give_its_number_of_confounders(count: int) -> None:
    import numpy as np

    operators = operators_of(Part("pick-up", count), load_operators("paper-rq1"))
    space = SearchSpace(operators, CATALOGUE, "pick-up")
    assert len(space.sample(np.random.default_rng(1)).confounders) == count


def test_a_run_that_is_over_is_taken_before_one_that_ended_early(tmp_path: Path) -> None:
    path = tmp_path / "a.db"
    with Store.open(path, "write") as store:
        for status in ("finished", "interrupted"):
            store.finish(store.begin(manifest()), status, 1.0)
        result = stored(store, manifest())
        assert result
        assert (result.id, result.status) == (1, "finished")
        assert stored(store, manifest(seed=9)) is None
        with pytest.raises(UsageError, match="another version than is installed: its commit"):
            stored(store, manifest(commit="abc"))


def test_a_run_of_given_scenes_is_of_these_or_of_the_first_of_them(tmp_path: Path) -> None:
    given = [scene(x=0.001 * number) for number in range(3)]
    with Store.open(tmp_path / "a.db", "write") as store:
        run_of(store, *((row, passed()) for row in given[:2]))
        assert stored(store, manifest(), given)
        assert stored(store, manifest(), given[1:]) is None
