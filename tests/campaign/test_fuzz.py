from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

from tests.campaign.resuming import SPACE
from tests.doubles import Always, Backwards, ClosedForm, Gone, Raising, Scripted, failed, manifest, passed, scene
from vlafuzz.campaign.fuzz import Campaign
from vlafuzz.campaign.tally import Summary
from vlafuzz.errors import PolicyError, PrerequisiteError, UsageError
from vlafuzz.model import Outcome, Verdict
from vlafuzz.rollouts.executor import LocalExecutor
from vlafuzz.search.proposals import InOrder, Random
from vlafuzz.store.store import Store


def run(store: Store, **changes) -> Summary:
    about = manifest(**{name: changes.pop(name) for name in list(changes) if name in ("budget", "batch", "repeats")})
    parts = {"space": SPACE, "strategy": Random(SPACE, 0), "executor": LocalExecutor(ClosedForm(about.repeats))}
    return Campaign(manifest=about, store=store, **(parts | changes)).run()


def scenes_of(store: Store, summary: Summary) -> list[tuple[str, Verdict]]:
    return [(trial.scene.digest, trial.outcome.verdict) for trial in store.trials(summary.run)]


def genomes(*scenes) -> list[np.ndarray]:
    return [SPACE.encode(each) for each in scenes]


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(budget=st.integers(1, 30), batch=st.integers(1, 20), repeats=st.integers(1, 4), seed=st.integers(0, 3))
def test_no_setting_exceeds_the_budget(tmp_path: Path, budget: int, batch: int, repeats: int, seed: int):
    (tmp_path / "a.db").unlink(missing_ok=True)
    with Store.open(tmp_path / "a.db", "write") as store:
        summary = run(store, budget=budget, batch=batch, repeats=repeats, strategy=Random(SPACE, seed))
    assert budget - repeats < summary.rollouts <= budget


def test_every_proposal_is_told_once_in_order_with_what_came_of_it(store: Store):
    strategy = Scripted(genomes(scene(0.25), scene(1.0), scene(x=0.08), scene(0.25), scene(4.0)))
    run(store, batch=2, strategy=strategy)
    assert [number for number, _ in strategy.told] == [0, 1, 2, 3, 4]
    assert [score.verdict.name for _, score in strategy.told] == ["FAILED", "PASSED", "INVALID", "FAILED", "PASSED"]
    assert [score.progress for _, score in strategy.told] == [0.25, 1.0, None, 0.25, 1.0]


def test_what_the_executor_does_changes_no_scene_and_nothing_told(store: Store, tmp_path: Path):
    told, stored = [], []
    for number, make in enumerate([LocalExecutor, Backwards]):
        strategy = Scripted([np.random.default_rng([7, index]).random(3) for index in range(40)])
        with Store.open(tmp_path / f"{number}.db", "write") as other:
            summary = run(other, strategy=strategy, executor=make(ClosedForm()))
            stored.append(scenes_of(other, summary))
        told.append(strategy.told)
    assert all(each == told[0] for each in told)
    assert all(each == stored[0] for each in stored)


def test_a_known_scene_is_answered_and_costs_nothing(store: Store):
    evaluator = ClosedForm()
    strategy = Scripted(genomes(scene(), scene(), scene(0.25), scene(), scene(0.25)))
    summary = run(store, batch=2, strategy=strategy, executor=LocalExecutor(evaluator))
    assert evaluator.evaluated == [scene(), scene(0.25)]
    assert (summary.rollouts, summary.proposals, summary.duplicates) == (2, 5, 3)
    assert summary.verdicts == {"failed": 1, "passed": 1, "invalid": 0, "error": 0}
    assert [trial.duplicate for trial in store.trials(summary.run)] == [False, True, False, True, True]


def test_a_repeated_run_is_answered_from_the_store_and_then_goes_on(store: Store):
    first, again = run(store, budget=20), run(store, budget=20)
    assert (first.duplicates, again.rollouts) == (0, 20)
    assert again.duplicates >= first.proposals
    assert scenes_of(store, again)[: first.proposals] == scenes_of(store, first)


def test_an_error_is_tried_again_by_the_next_run(store: Store):
    strategy = [Scripted(genomes(scene())) for _ in range(2)]
    broken = run(store, strategy=strategy[0], executor=LocalExecutor(Raising(OSError("gone"))))
    whole = run(store, strategy=strategy[1])
    assert (broken.verdicts["error"], broken.first_error) == (1, "OSError: gone")
    assert whole.verdicts["passed"] == 1


def test_the_same_failing_scene_is_one_finding_of_both_runs(store: Store):
    one, other = (run(store, strategy=Scripted(genomes(scene(0.25)))) for _ in range(2))
    assert (one.findings, other.findings, other.rollouts) == (1, 1, 0)
    assert len(store.findings()) == 1


def test_the_summary_counts_scenes_by_what_came_of_them(store: Store):
    pool = [scene(0.0625), scene(0.125), scene(1.0), scene(x=0.08)]
    summary = run(store, scenes=pool, strategy=InOrder(4))
    assert summary.invalid == {"geometry": 1}
    assert summary.first_failure == scene(0.0625).digest
    assert summary.findings == 2
    assert all(found.cell == "grasp|light" for found in store.findings())


def test_it_stops_when_no_scene_is_fair_and_says_which_check_rejects_them(store: Store):
    invalid = Outcome.invalid("geometry", "green_cube is out of reach")
    summary = run(store, budget=1000, executor=LocalExecutor(Always(invalid)))
    assert summary.stopped is not None
    assert summary.stopped.startswith("no rollout in 50 proposals in a row: rejected by the geometry check (")
    assert summary.stopped.endswith("; the last of them: green_cube is out of reach")
    assert (summary.proposals, store.runs()[0].status) == (50 + 7, "stopped")  # 7 were outstanding


def test_it_goes_on_as_long_as_now_and_then_a_scene_is_fair(store: Store):
    unfair = [scene(2.0**light, 0.08, 0.05 * y) for light in range(-4, 5) for y in range(-2, 3)]
    pool = [*unfair[:40], scene(), *unfair[40:], *(scene(x=0.12, y=0.05 * y) for y in range(-4, 5))]
    summary = run(store, scenes=pool, strategy=InOrder(len(pool)), budget=100)
    assert (summary.stopped, summary.proposals) == (None, len(pool))


def test_it_stops_when_a_strategy_proposes_one_scene_for_ever(store: Store):
    summary = run(store, budget=1000, strategy=Scripted(genomes(scene()) * 500))
    assert summary.stopped == "no rollout in 55 proposals in a row: asked before (55)"


@pytest.mark.parametrize("batch", [1, 64])
def test_it_stops_soon_when_scenes_in_a_row_end_in_an_error(store: Store, batch: int):
    class Breaking(Always):
        def evaluate(self, scenes):
            steps = [int(scene.digest, 16) % 80 for scene in scenes]
            return [Outcome.error(f"policy: act: step {step}: IndexError") for step in steps]

    executor = LocalExecutor(Breaking(passed()))
    summary = run(store, executor=executor, budget=200, batch=batch)
    assert summary.verdicts == {"failed": 0, "passed": 0, "invalid": 0, "error": 8}
    assert summary.stopped.startswith("8 scenes in a row ended in an error, the last: policy: act: step ")
    assert store.runs()[0].status == "interrupted"


FAIR = [scene(2.0**light, y=0.05 * y) for light in range(-4, 2) for y in range(-2, 3)]


def test_a_policy_that_is_gone_ends_the_run_and_its_scenes_are_errors(store: Store):
    parts = {"scenes": FAIR, "strategy": InOrder(len(FAIR)), "batch": len(FAIR)}
    with pytest.raises(PolicyError, match=r"^8 scenes in a row had no answer: policy: connect: refused$"):
        run(store, executor=LocalExecutor(Gone(after=5)), **parts)
    (gone,) = store.runs()
    assert gone.status == "interrupted"
    assert [trial.scene for trial in store.trials(gone.id) if trial.outcome.judged] == FAIR[:5]


def test_unfair_scenes_do_not_say_that_the_policy_is_still_there(store: Store):
    with pytest.raises(PolicyError, match="8 scenes in a row"):
        run(store, budget=1000, executor=LocalExecutor(Gone()))
    assert Verdict.INVALID in {trial.outcome.verdict for trial in store.trials(1)}


@pytest.mark.parametrize("batch", [1, 3, 5, 8, 30])
def test_a_policy_that_comes_back_is_judged_by_all_scenes(tmp_path: Path, batch: int):
    parts = {"scenes": FAIR, "budget": 1000, "batch": batch, "patience": None}
    with Store.open(tmp_path / "b.db", "write") as store:
        with pytest.raises(PolicyError):
            run(store, executor=LocalExecutor(Gone(after=5)), strategy=InOrder(len(FAIR)), **parts)
        back = run(store, strategy=InOrder(len(FAIR)), resume=1, **parts)
    assert (back.proposals, back.verdicts["error"], back.rollouts) == (len(FAIR), 0, len(FAIR))


@pytest.mark.parametrize("batch", [1, 16])
def test_errors_in_mid_run_leave_a_run_that_comes_to_what_it_would_have_come_to(tmp_path: Path, batch: int):
    class Broken(ClosedForm):
        """From the fifth scene on."""

        def outcome(self, scene):
            if len(self.evaluated) > 4:
                return Outcome.error(f"policy: remote: 500 {scene.digest}")
            return super().outcome(scene)

    with Store.open(tmp_path / "a.db", "write") as store:
        first = run(store, executor=LocalExecutor(Broken()), budget=40, batch=batch)
        judged = first.verdicts["passed"] + first.verdicts["failed"]
        assert first.short.startswith(f"{judged} of 40 rollouts could be judged: ")
        assert store.runs()[0].status == "interrupted"
        back = run(store, budget=40, batch=batch, resume=1)
        assert (back.short, back.rollouts, store.runs()[0].status) == (None, 40, "finished")
        kept = [trial.outcome.verdict for trial in store.trials(1)]
    with Store.open(tmp_path / "b.db", "write") as store:
        run(store, budget=40, batch=batch)
        assert kept == [trial.outcome.verdict for trial in store.trials(1)]


def test_a_policy_that_answers_now_and_then_is_not_gone(store: Store):
    parts = {"scenes": FAIR, "strategy": InOrder(len(FAIR))}
    summary = run(store, executor=LocalExecutor(Gone(every=8)), **parts)
    assert (summary.rollouts, summary.verdicts["error"]) == (3, 27)


def test_scenes_that_break_the_simulator_do_not_end_a_file_of_scenes(store: Store):
    parts = {"scenes": FAIR, "strategy": InOrder(len(FAIR)), "patience": None}
    summary = run(store, executor=LocalExecutor(Raising(ConnectionError("refused"), after=5)), **parts)
    assert (summary.rollouts, summary.verdicts["error"]) == (5, 25)


def test_what_earlier_runs_answered_is_counted(store: Store):
    run(store, strategy=Scripted(genomes(scene(0.25), scene(1.0))))
    summary = run(store, strategy=Scripted(genomes(scene(0.25), scene(0.25), scene(0.5))))
    assert (summary.duplicates, summary.earlier) == (2, 1)


def test_an_error_costs_the_rollouts_that_it_ran(store: Store):
    half_way = Outcome(verdict=Verdict.ERROR, rollouts=passed().rollouts, detail="the connection broke in rollout 2")
    summary = run(store, budget=6, repeats=3, executor=LocalExecutor(Always(half_way)))
    assert (summary.rollouts, summary.verdicts["error"]) == (4, 4)


def test_what_must_be_installed_first_ends_the_run_as_failed(store: Store):
    with pytest.raises(PrerequisiteError):
        run(store, executor=LocalExecutor(Raising(PrerequisiteError("no renderer"))))
    assert store.runs()[0].status == "failed"


def test_a_strategy_that_proposes_too_much_is_refused(store: Store):
    class Greedy(Scripted):
        def ask(self, n: int):
            return super().ask(n + 1)

    with pytest.raises(UsageError, match="asked for 8 proposals, got 9"):
        run(store, strategy=Greedy(genomes(scene()) * 20))


def test_one_is_told_of_every_trial_as_it_is_stored(store: Store):
    seen = []
    run(store, budget=5, batch=5, executor=LocalExecutor(Always(failed())), watch=lambda t: seen.append(t.rollouts))
    assert seen == [1, 2, 3, 4, 5]


def test_a_run_alone_pays_for_what_other_runs_know_and_only_once(store: Store):
    asked = genomes(scene(0.25), scene(1.0), scene(0.25))
    run(store, strategy=Scripted(asked))
    evaluator = ClosedForm()
    summary = run(store, strategy=Scripted(asked), executor=LocalExecutor(evaluator), batch=2, alone=True)
    assert evaluator.evaluated == [scene(0.25), scene(1.0)]
    assert (summary.rollouts, summary.duplicates) == (2, 1)
    assert run(store, strategy=Scripted(asked)).rollouts == 0
