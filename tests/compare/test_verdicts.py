from dataclasses import replace

import pytest

from vlafuzz.compare.figures import Figures
from vlafuzz.compare.verdicts import MEASURES, Pair, against, corrected

RUN = Figures(
    run=1, strategy="random", seed=0, rollouts=20, failures=5, cells=3, coverage=0.5, cid=1.0, qd_score=2.0,
    sparseness=0.5, severity=3.0, first_failure=4, tenth_failure=None, proposals=30, valid_share=0.9,
    rejected=3, errors=0, seconds=9.0, rollout_seconds=8.0,
    search_seconds=0.9, search_share=0.1, store_seconds=None, store_share=None,
)  # fmt: skip


def runs(**cells: list[int]) -> dict[str, list[Figures]]:
    return {
        name: [replace(RUN, strategy=name, cells=count) for count in counts] for name, counts in cells.items()
    }


def first(pairs: list[Pair]) -> Pair:
    return next(pair for pair in pairs if pair.measure == "cells")


CLEAR = {"random": [4, 5, 6, 5, 4, 5, 7, 4, 5, 6], "mine": [10, 10, 12, 11, 8, 10, 13, 9, 11, 10]}


def test_a_clear_difference_is_told_with_effect_interval_and_p():
    pair = first(against(runs(**CLEAR), "random"))
    assert pair.verdict == (
        "more distinct cells than random: 2x (1.9 to 2.2), more in 10 and fewer in 0 of 10 pairs, "
        "p 0.014 after Holm over 7 tests"
    )


def test_less_of_it_is_told_too():
    pair = first(against(runs(random=CLEAR["mine"], mine=CLEAR["random"]), "random"))
    assert pair.verdict.startswith("fewer distinct cells than random: 0.49x")
    assert pair.verdict.endswith(", which is worse")


def test_where_none_is_shown_it_says_so():
    pair = first(against(runs(random=[4, 5, 6, 5, 4] * 2, mine=[5, 4, 6, 5, 5] * 2), "random"))
    assert pair.verdict.startswith("no difference shown from random in distinct cells: 1x (")
    assert "more in 4 and fewer in 2 of 10 pairs, p 1 after" in pair.verdict


def test_too_few_repeats_are_said_to_be_so_whatever_they_show():
    pair = first(against(runs(random=[1, 2, 1], mine=[9, 8, 9], other=[1, 1, 1]), "random"))
    assert not pair.tells
    assert "3 repeats are too few to tell, p is never below 1; 10 could (6.5x (" in pair.verdict


def test_where_the_reference_finds_nothing_the_difference_is_told():
    pair = first(against(runs(random=[0] * 10, mine=CLEAR["mine"]), "random"))
    assert pair.ratio is None
    assert "than random: mean difference 10.4 (9.38 to 11.4), more in 10" in pair.verdict


def test_p_values_are_corrected_for_every_strategy_in_every_measure():
    alone, among = against(runs(**CLEAR), "random"), against(runs(**CLEAR, other=[5] * 10), "random")
    assert (len(alone), len(among)) == (len(MEASURES), 2 * len(MEASURES))
    assert first(alone).p_holm == pytest.approx(len(alone) * first(alone).test.p)
    assert first(among).p_holm == pytest.approx(len(among) * first(among).test.p)


def test_tests_of_several_tasks_are_corrected_together():
    task = against(runs(**CLEAR), "random")
    together = corrected([*task, *task])
    assert first(together).tests == 2 * len(task)
    assert first(together).p_holm == pytest.approx(2 * first(task).p_holm)
    assert first(together).verdict.endswith("p 0.027 after Holm over 14 tests")


def test_a_run_that_never_fails_is_later_than_any_that_does():
    figures = runs(random=[3] * 9, mine=[3] * 9)
    figures["random"] = [replace(run, first_failure=None) for run in figures["random"]]
    pair = next(pair for pair in against(figures, "random") if pair.measure == "first_failure")
    assert (pair.test.fewer, pair.ratio) == (9, None)
    assert pair.verdict == (
        "fewer rollouts to the first failure than random: more in 0 and fewer in 9 of 9 pairs, "
        "p 0.027 after Holm over 7 tests"
    )
