from dataclasses import replace

from vlafuzz.compare.figures import Figures
from vlafuzz.compare.verdicts import Pair, against, each_pair

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


def test_a_clear_difference_is_told_with_effect_interval_and_p():
    pair = first(against(runs(random=[4, 5, 6, 5, 4, 5], mine=[10, 10, 12, 10, 8, 10]), "random"))
    assert pair.verdict == "more distinct cells than random: 2.1x (2 to 2.2), A12 1.00, p 0.0022"


def test_less_of_it_is_told_too():
    pair = first(against(runs(random=[9, 8, 9, 7], mine=[2, 2, 3, 2]), "random"))
    assert pair.verdict.startswith("fewer distinct cells than random: 0.27x")
    assert pair.verdict.endswith(", which is worse")


def test_where_none_is_shown_it_says_so():
    pair = first(against(runs(random=[4, 5, 6, 5, 4], mine=[5, 4, 6, 5, 5]), "random"))
    assert pair.verdict.startswith("no difference shown from random in distinct cells: 1x (")


def test_too_few_repeats_are_said_to_be_so_whatever_they_show():
    pair = first(against(runs(random=[1, 1, 1], mine=[9, 9, 9], other=[1, 1, 1]), "random"))
    assert (pair.tells, pair.a12) == (False, 1.0)
    assert "3 repeats are too few to tell, p is never below 0.2; 5 could" in pair.verdict


def test_more_strategies_make_p_values_larger():
    mine = {"random": [4, 5, 6, 5, 4], "mine": [9, 9, 8, 9, 9]}
    alone, among = against(runs(**mine), "random"), against(runs(**mine, other=[4, 5, 6, 5, 5]), "random")
    assert first(alone).p == first(among).p == first(alone).p_holm
    assert first(among).p_holm == 2 * first(among).p


def test_every_pair_is_there_once():
    pairs = [pair for pair in each_pair(runs(a=[1, 2], b=[1, 2], c=[1, 2])) if pair.measure == "cells"]
    assert [(pair.strategy, pair.other) for pair in pairs] == [("b", "a"), ("c", "a"), ("c", "b")]


def test_a_run_that_never_fails_is_later_than_any_that_does():
    figures = runs(random=[3, 3, 3, 3], mine=[3, 3, 3, 3])
    figures["random"] = [replace(run, first_failure=None) for run in figures["random"]]
    pair = next(pair for pair in against(figures, "random") if pair.measure == "first_failure")
    assert (pair.a12, pair.ratio) == (0.0, None)
    assert pair.verdict == "fewer rollouts to the first failure than random: A12 0.00, p 0.029"
