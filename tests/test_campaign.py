import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.doubles import (
    STAGES,
    Always,
    Backwards,
    ClosedForm,
    Gone,
    Raising,
    Scripted,
    TinySpace,
    failed,
    manifest,
    passed,
    scene,
)  # fmt: skip
from vlafuzz.campaign import fuzz
from vlafuzz.corpus.store import Corpus
from vlafuzz.corpus.tally import Summary
from vlafuzz.errors import PrerequisiteError, SubjectError, UsageError
from vlafuzz.execute.local import LocalExecutor
from vlafuzz.outcome import Outcome, Verdict
from vlafuzz.search.pool import InOrder, Pool
from vlafuzz.search.random import Random

SPACE = TinySpace()


@pytest.fixture
def corpus(tmp_path: Path):
    with Corpus.open(tmp_path / "a.db", "write") as opened:
        yield opened


def run(corpus: Corpus, **changes) -> Summary:
    about = manifest(
        **{name: changes.pop(name) for name in list(changes) if name in ("budget", "batch", "repeats")}
    )
    parts = {
        "space": SPACE,
        "strategy": Random(SPACE, 0),
        "executor": LocalExecutor(ClosedForm(about.repeats)),
    }
    return fuzz(manifest=about, stages=STAGES, corpus=corpus, **(parts | changes))


def scenes_of(corpus: Corpus, summary: Summary) -> list[tuple[str, Verdict]]:
    return [(trial.scene.digest, trial.outcome.verdict) for trial in corpus.trials(summary.run)]


def genomes(*scenes) -> list[np.ndarray]:
    return [SPACE.encode(each) for each in scenes]


def test_the_budget_is_spent_to_the_last_rollout(corpus: Corpus):
    summary = run(corpus, budget=37, batch=16)
    assert summary.rollouts == 37
    assert summary.verdicts["passed"] + summary.verdicts["failed"] == 37
    assert summary.verdicts["invalid"] > 0


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(budget=st.integers(1, 30), batch=st.integers(1, 20), repeats=st.integers(1, 4), seed=st.integers(0, 3))
def test_no_setting_exceeds_the_budget(tmp_path: Path, budget: int, batch: int, repeats: int, seed: int):
    (tmp_path / "a.db").unlink(missing_ok=True)
    with Corpus.open(tmp_path / "a.db", "write") as corpus:
        summary = run(corpus, budget=budget, batch=batch, repeats=repeats, strategy=Random(SPACE, seed))
    assert budget - repeats < summary.rollouts <= budget


def test_every_proposal_is_told_once_in_order_with_what_came_of_it(corpus: Corpus):
    strategy = Scripted(genomes(scene(0.25), scene(1.0), scene(x=0.08), scene(0.25), scene(4.0)))
    run(corpus, batch=2, strategy=strategy)
    assert [number for number, _ in strategy.told] == [0, 1, 2, 3, 4]
    assert [score.verdict.name for _, score in strategy.told] == [
        "FAILED",
        "PASSED",
        "INVALID",
        "FAILED",
        "PASSED",
    ]
    assert [score.progress for _, score in strategy.told] == [0.25, 1.0, None, 0.25, 1.0]


def test_what_the_executor_does_changes_no_scene_and_nothing_told(corpus: Corpus, tmp_path: Path):
    told, stored = [], []
    for number, make in enumerate([LocalExecutor, Backwards]):
        for chunk in (1, 3, 100):
            strategy = Scripted([np.random.default_rng([7, index]).random(3) for index in range(40)])
            with Corpus.open(tmp_path / f"{number}-{chunk}.db", "write") as other:
                summary = run(other, strategy=strategy, executor=make(ClosedForm()), chunk=chunk)
                stored.append(scenes_of(other, summary))
            told.append(strategy.told)
    assert all(each == told[0] for each in told)
    assert all(each == stored[0] for each in stored)


def test_a_known_scene_is_answered_and_costs_nothing(corpus: Corpus):
    evaluator = ClosedForm()
    strategy = Scripted(genomes(scene(), scene(), scene(0.25), scene(), scene(0.25)))
    summary = run(corpus, batch=2, strategy=strategy, executor=LocalExecutor(evaluator))
    assert evaluator.evaluated == [scene(), scene(0.25)]
    assert (summary.rollouts, summary.proposals, summary.duplicates) == (2, 5, 3)
    assert summary.verdicts == {"failed": 1, "passed": 1, "invalid": 0, "error": 0}
    assert [trial.duplicate for trial in corpus.trials(summary.run)] == [False, True, False, True, True]


def test_a_repeated_run_is_answered_from_the_store_and_then_goes_on(corpus: Corpus):
    first, again = run(corpus, budget=20), run(corpus, budget=20)
    assert (first.duplicates, again.rollouts) == (0, 20)
    assert again.duplicates >= first.proposals
    assert scenes_of(corpus, again)[: first.proposals] == scenes_of(corpus, first)


def test_an_error_is_tried_again_by_the_next_run(corpus: Corpus):
    strategy = [Scripted(genomes(scene())) for _ in range(2)]
    broken = run(corpus, strategy=strategy[0], executor=LocalExecutor(Raising(OSError("gone"))))
    whole = run(corpus, strategy=strategy[1])
    assert (broken.verdicts["error"], broken.last_error) == (1, "OSError: gone")
    assert whole.verdicts["passed"] == 1


def test_the_same_failing_scene_is_one_finding_of_both_runs(corpus: Corpus):
    one, other = (run(corpus, strategy=Scripted(genomes(scene(0.25)))) for _ in range(2))
    assert (one.findings, other.findings, other.rollouts) == (1, 1, 0)
    assert len(corpus.findings()) == 1


def test_the_summary_counts_scenes_by_what_was_reached(corpus: Corpus):
    pool = [scene(0.0625), scene(0.125), scene(1.0), scene(x=0.08)]
    summary = run(corpus, space=Pool(pool, SPACE), strategy=InOrder(4))
    assert summary.stages == {"grasp": 1, "lift": 1, "success": 1}
    assert summary.invalid == {"geometry": 1}
    assert summary.progress_mean == pytest.approx((0.0625 + 0.125 + 1.0) / 3)
    assert summary.first_failure == scene(0.0625).digest
    assert (summary.findings, summary.distinct_cells) == (2, 1)
    assert all(found.cell.startswith("grasp|light|") for found in corpus.findings())


def test_a_pool_ends_when_each_scene_was_run(corpus: Corpus):
    pool = [scene(x=-0.01 * number) for number in range(10)]
    summary = run(corpus, budget=1000, batch=4, space=Pool(pool, SPACE), strategy=InOrder(10))
    assert (summary.rollouts, summary.stopped, corpus.runs()[0].status) == (10, None, "finished")


def test_it_stops_when_no_scene_is_fair_and_says_which_check_rejects_them(corpus: Corpus):
    invalid = Outcome.invalid("geometry", "green_cube is out of reach")
    summary = run(corpus, budget=1000, executor=LocalExecutor(Always(invalid)))
    assert summary.stopped is not None
    assert summary.stopped.startswith("no rollout in 56 proposals in a row: rejected by the geometry check (")
    assert summary.stopped.endswith("the last of them: green_cube is out of reach")
    assert (summary.proposals, corpus.runs()[0].status) == (56, "stopped")


def test_it_goes_on_as_long_as_now_and_then_a_scene_is_fair(corpus: Corpus):
    unfair = [scene(2.0**light, 0.08, 0.05 * y) for light in range(-4, 5) for y in range(-2, 3)]
    pool = [*unfair[:40], scene(), *unfair[40:], *(scene(x=0.12, y=0.05 * y) for y in range(-4, 5))]
    summary = run(corpus, space=Pool(pool, SPACE), strategy=InOrder(len(pool)), budget=100)
    assert (summary.stopped, summary.proposals) == (None, len(pool))


def test_it_stops_when_a_strategy_proposes_one_scene_for_ever(corpus: Corpus):
    summary = run(corpus, budget=1000, strategy=Scripted(genomes(scene()) * 500))
    assert summary.stopped == "no rollout in 55 proposals in a row: asked before (55)"


def test_it_stops_when_each_scene_is_an_error(corpus: Corpus):
    summary = run(corpus, budget=1000, executor=LocalExecutor(Raising(ConnectionError("refused"))))
    assert summary.stopped is not None
    assert "subject or simulator error" in summary.stopped
    assert "ConnectionError: refused" in summary.stopped


FAIR = [scene(2.0**light, y=0.05 * y) for light in range(-4, 2) for y in range(-2, 3)]


def test_a_subject_that_is_gone_ends_the_run_and_its_scenes_are_not_judged(corpus: Corpus):
    parts = {"space": Pool(FAIR, SPACE), "strategy": InOrder(len(FAIR)), "batch": len(FAIR)}
    with pytest.raises(SubjectError, match=r"^8 scenes in a row had no answer: subject: connect: refused$"):
        run(corpus, executor=LocalExecutor(Gone(after=5)), **parts)
    (gone,) = corpus.runs()
    assert gone.status == "interrupted"
    assert [trial.scene for trial in corpus.trials(gone.id)] == FAIR[:5]


def test_unfair_scenes_do_not_say_that_the_subject_is_still_there(corpus: Corpus):
    with pytest.raises(SubjectError, match="8 scenes in a row"):
        run(corpus, budget=1000, executor=LocalExecutor(Gone()))
    assert Verdict.INVALID in {trial.outcome.verdict for trial in corpus.trials(1)}


@pytest.mark.parametrize("batch", [1, 3, 5, 8, 30])
def test_a_subject_that_comes_back_is_judged_by_all_scenes_of_the_batch_that_it_left(
    tmp_path: Path, batch: int
):
    parts = {"space": Pool(FAIR, SPACE), "budget": 1000, "batch": batch, "patience": None}
    with Corpus.open(tmp_path / "b.db", "write") as corpus:
        with pytest.raises(SubjectError):
            run(corpus, executor=LocalExecutor(Gone(after=5)), strategy=InOrder(len(FAIR)), **parts)
        back = run(corpus, strategy=InOrder(len(FAIR)), resume=1, **parts)
    told = max((5 + 8 - 1) // batch * batch - 5, 0)  # of the batches before, which the strategy knows of
    assert (back.proposals, back.verdicts["error"], back.rollouts) == (len(FAIR), told, len(FAIR) - told)


def test_a_subject_that_answers_now_and_then_is_not_gone(corpus: Corpus):
    parts = {"space": Pool(FAIR, SPACE), "strategy": InOrder(len(FAIR))}
    summary = run(corpus, executor=LocalExecutor(Gone(every=8)), **parts)
    assert (summary.rollouts, summary.verdicts["error"]) == (3, 27)


def test_scenes_that_break_the_simulator_do_not_end_a_file_of_scenes(corpus: Corpus):
    parts = {"space": Pool(FAIR, SPACE), "strategy": InOrder(len(FAIR)), "patience": None}
    summary = run(corpus, executor=LocalExecutor(Raising(ConnectionError("refused"), after=5)), **parts)
    assert (summary.rollouts, summary.verdicts["error"]) == (5, 25)


def test_what_earlier_runs_answered_is_counted(corpus: Corpus):
    run(corpus, strategy=Scripted(genomes(scene(0.25), scene(1.0))))
    summary = run(corpus, strategy=Scripted(genomes(scene(0.25), scene(0.25), scene(0.5))))
    assert (summary.duplicates, summary.earlier) == (2, 1)


def test_an_error_costs_the_rollouts_that_it_ran(corpus: Corpus):
    half_way = Outcome(Verdict.ERROR, passed().rollouts, detail="the connection broke in rollout 2")
    summary = run(corpus, budget=6, repeats=3, executor=LocalExecutor(Always(half_way)))
    assert (summary.rollouts, summary.verdicts["error"]) == (4, 4)


def test_an_interruption_keeps_all_trials_up_to_it(corpus: Corpus):
    with pytest.raises(KeyboardInterrupt):
        run(corpus, executor=LocalExecutor(Raising(KeyboardInterrupt(), after=5)))
    (interrupted,) = corpus.runs()
    assert interrupted.status == "interrupted"
    assert len(list(corpus.trials(interrupted.id))) == 5


def test_what_must_be_installed_first_ends_the_run_as_failed(corpus: Corpus):
    with pytest.raises(PrerequisiteError):
        run(corpus, executor=LocalExecutor(Raising(PrerequisiteError("no renderer"))))
    assert corpus.runs()[0].status == "failed"


def test_a_strategy_that_proposes_too_much_is_refused(corpus: Corpus):
    class Greedy(Scripted):
        def ask(self, n: int):
            return super().ask(n + 1)

    with pytest.raises(UsageError, match="asked for 8 proposals, got 9"):
        run(corpus, strategy=Greedy(genomes(scene()) * 20))


def test_one_is_told_of_every_trial_as_it_is_stored(corpus: Corpus):
    seen = []
    run(
        corpus,
        budget=5,
        batch=5,
        executor=LocalExecutor(Always(failed())),
        watch=lambda t: seen.append(t.rollouts),
    )
    assert seen == [1, 2, 3, 4, 5]


def test_a_run_alone_pays_for_what_other_runs_know_and_only_once(corpus: Corpus):
    asked = genomes(scene(0.25), scene(1.0), scene(0.25))
    run(corpus, strategy=Scripted(asked))
    evaluator = ClosedForm()
    summary = run(corpus, strategy=Scripted(asked), executor=LocalExecutor(evaluator), batch=2, alone=True)
    assert evaluator.evaluated == [scene(0.25), scene(1.0)]
    assert (summary.rollouts, summary.duplicates) == (2, 1)
    assert run(corpus, strategy=Scripted(asked)).rollouts == 0


class Slow(Random):
    """A strategy that takes its time, asked and told."""

    def ask(self, n: int):
        time.sleep(0.01)
        return super().ask(n)

    def tell(self, proposals, scores) -> None:
        time.sleep(0.01)
        super().tell(proposals, scores)


def test_the_time_of_search_and_store_is_kept_apart_from_the_rollouts(corpus: Corpus):
    summary = run(corpus, budget=20, batch=10, strategy=Slow(SPACE, 0))
    (kept,) = corpus.runs()
    assert kept.search_seconds == summary.search_seconds >= 4 * 0.01
    assert kept.store_seconds == summary.store_seconds > 0
    assert kept.seconds is not None
    assert summary.search_seconds + summary.store_seconds <= kept.seconds <= summary.seconds
