import sqlite3
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.doubles import failed, manifest, passed, rollout, scene, trial
from vlafuzz.errors import StoreError
from vlafuzz.model import Outcome, Verdict
from vlafuzz.store.store import Store

KEY = manifest().key()


def test_a_run_comes_back_with_its_manifest(store: Store):
    asked = manifest(versions={"numpy": "2"}, stop_early=True, commit="abc", seed=2**62)
    number = store.begin(asked)
    store.finish(number, "finished", 1.5)
    (run,) = store.runs()
    assert (run.id, run.manifest, run.status, run.seconds) == (number, asked, "finished", 1.5)


def test_a_run_that_is_gone_on_with_has_what_it_took_and_not_its_parallel_rollouts(store: Store):
    run = store.begin(manifest())
    for proposal in range(3):
        store.add(run, trial(proposal, passed()))
    store.finish(run, "interrupted", 0.25)
    assert store.reopen(run) == 0.25


def test_a_failing_trial_comes_back_bit_by_bit(store: Store):
    actions = np.random.default_rng(0).normal(size=(9, 7)).astype(np.float32)
    rolled = replace(rollout(0.25, ("grasp",)), actions=actions, trace=actions[:, 0], recovery=7)
    kept = trial(0, Outcome.of((rolled, rolled), ("grasp", "lift", "success")))
    run = store.begin(manifest())
    store.add(run, kept)
    (got,) = store.trials(run)
    assert (got.scene, got.cell, got.severity, got.duplicate) == (kept.scene, kept.cell, 0.5, False)
    ended = (got.outcome.verdict, got.outcome.progress, got.outcome.lost_stage)
    assert ended == (Verdict.FAILED, 0.25, "lift")
    assert got.genome.tobytes() == kept.genome.tobytes()
    assert len(got.outcome.rollouts) == 2
    again = got.outcome.rollouts[1]
    assert (again.reached, again.steps, again.states_hash) == (("grasp",), 9, rolled.states_hash)
    assert again.recovery == 7
    assert np.array_equal(again.actions, actions)
    assert np.array_equal(again.trace, actions[:, 0])


def test_a_passing_rollout_keeps_its_trace_but_no_actions(store: Store):
    run = store.begin(manifest())
    store.add(run, trial(0, passed()))
    (rolled,) = next(store.trials(run)).outcome.rollouts
    assert (rolled.steps, rolled.actions.shape) == (4, (0, 7))


def test_not_a_number_never_goes_in(store: Store, path: Path):
    broken = replace(rollout(float("nan"), ()), seconds=float("nan"))
    outcome = Outcome(verdict=Verdict.FAILED, rollouts=(broken,), progress=float("nan"), lost_stage="grasp")
    store.add(store.begin(manifest()), trial(0, outcome))
    with sqlite3.connect(path) as raw:
        assert raw.execute("SELECT progress, seconds FROM trial").fetchall() == [(None, 0.0)]
        assert raw.execute("SELECT progress, seconds FROM rollout").fetchall() == [(None, 0.0)]
    raw.close()


@pytest.mark.parametrize("outcome", [passed(), failed(), Outcome.invalid("geometry", "too far")])
def test_an_evaluated_scene_is_known(store: Store, outcome: Outcome):
    kept = trial(0, outcome)
    store.add(store.begin(manifest()), kept)
    known = store.known(kept.scene, KEY)
    for name in ("verdict", "progress", "detail", "check"):
        assert getattr(known, name) == getattr(outcome, name)
    assert len(known.rollouts) == len(outcome.rollouts)


def test_what_is_known_comes_with_its_rollouts_also_after_a_duplicate(store: Store):
    run = store.begin(manifest())
    store.add(run, trial(0, passed()))
    store.add(run, replace(trial(1, passed(), duplicate=True), scene=scene(x=0)))
    assert len(store.known(scene(x=0), KEY).rollouts) == 1


def test_one_may_ask_for_what_a_run_knows_by_itself(store: Store):
    first, second = store.begin(manifest()), store.begin(manifest())
    store.add(first, trial(0, passed()))
    assert store.known(scene(x=0), KEY, second) is None
    store.add(second, trial(0, failed()))
    verdicts = [store.known(scene(x=0), KEY, each).verdict for each in (first, second, None)]
    assert verdicts == [Verdict.PASSED, Verdict.FAILED, Verdict.FAILED]


def test_a_stored_duplicate_has_the_rollouts_of_its_own_run_where_that_has_any(store: Store):
    first, second = store.begin(manifest()), store.begin(manifest())
    store.add(first, trial(0, passed(1)))
    store.add(second, trial(0, passed(3)))
    store.add(first, replace(trial(1, passed(), duplicate=True), scene=scene(x=0)))
    assert [len(each.outcome.rollouts) for each in store.stored(first, 0, 2)] == [1, 1]


@pytest.mark.parametrize(
    "change",
    [
        {"policy": "other"},
        {"spec": '{"version": "2"}'},
        {"seed": 1},
        {"repeats": 5},
        {"criteria": "published"},
        {"stop_early": True},
        {"world": {"min_distance": 0.2}},
        {"catalogue_digest": "d"},
        {"simulator": "other"},
        {"commit": "another version of our own code"},
        {"place": "another place"},
    ],
    ids=str,
)
def test_an_outcome_says_nothing_of_other_conditions(store: Store, change: dict[str, object]):
    store.add(store.begin(manifest()), trial(0, passed()))
    assert store.known(scene(x=0), manifest(**change).key()) is None


def test_budget_batch_and_strategy_do_not_change_what_is_known():
    assert manifest(budget=7, batch=3, strategy="other", command="x").key() == KEY


def test_a_finding_is_kept_once_a_policy_and_listed_in_each_run_that_failed(store: Store):
    first, second, other = (store.begin(manifest(policy=name)) for name in ("idle", "idle", "other"))
    for run in (first, second, other):
        store.add(run, trial(0, failed(), duplicate=run == second))
        store.add(run, trial(1, passed()))
    assert [found.run for found in store.findings()] == [first, other]
    assert [found.run for found in store.findings(second)] == [first]
    assert [found.run for found in store.findings(other)] == [other]


def test_findings_come_in_the_order_of_proposals_whichever_was_done_first(store: Store):
    run = store.begin(manifest())
    for proposal in (2, 0, 1):
        store.add(run, trial(proposal, failed()))
    scenes = [trial(proposal, failed()).scene for proposal in range(3)]
    assert [finding.scene for finding in store.findings()] == scenes
    assert [finding.scene for finding in store.findings(run)] == scenes


def test_a_scene_is_found_by_the_beginning_of_its_digest(store: Store):
    kept = trial(0, passed())
    store.add(store.begin(manifest()), kept)
    assert store.scene(kept.scene.digest[:8].upper()) == kept.scene


def test_a_beginning_that_fits_several_scenes_or_none_is_refused(store: Store):
    run = store.begin(manifest())
    for proposal in range(20):
        store.add(run, trial(proposal, passed()))
    with pytest.raises(StoreError, match="fits several scenes") as caught:
        store.scene("")
    assert "more digits" in str(caught.value.hint)
    with pytest.raises(StoreError, match="no scene 'xyz'"):
        store.scene("xyz")


def test_an_unknown_run_is_refused_with_the_known_ones(store: Store):
    store.begin(manifest())
    with pytest.raises(StoreError, match="no run 7") as caught:
        list(store.trials(7))
    assert caught.value.hint == "its runs: 1"


def test_a_copy_of_the_file_has_everything_although_somebody_follows_the_run(path: Path, tmp_path: Path):
    Store.open(path, "write").close()
    with Store.open(path) as following:
        assert following.runs() == []
        with Store.open(path, "write") as writing:
            writing.finish(writing.begin(manifest()), "finished", 1.0)
        assert len(following.runs()) == 1
        copy = tmp_path / "copy.db"
        copy.write_bytes(path.read_bytes())
        with Store.open(copy) as alone:
            assert [run.status for run in alone.runs()] == ["finished"]
