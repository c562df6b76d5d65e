import pytest

from vlafuzz.lab.comparison import Counted, Pair, against


def counted(strategy: str, seed: int, causes: int | None) -> Counted:
    return Counted(run=1, strategy=strategy, seed=seed, rollouts=20, causes=causes, failures=5, probability=None)


def runs(**causes: list[int]) -> dict[str, list[Counted]]:
    """Runs with so many causes; they are alike in all other measures."""
    return {name: [counted(name, seed, count) for seed, count in enumerate(counts)] for name, counts in causes.items()}


def first(pairs: list[Pair]) -> Pair:
    return next(pair for pair in pairs if pair.measure == "causes")


CLEAR = {"random": [4, 5, 6, 5, 4, 5, 7, 4, 5, 6], "mine": [10, 10, 12, 11, 8, 10, 13, 9, 11, 10]}


def test_a_clear_difference_is_told_with_effect_interval_and_p_in_either_direction():
    pair = first(against(runs(**CLEAR), "random"))
    assert pair.verdict == (
        "more certified causes than random: 2x (1.9 to 2.2), more in 10 and fewer in 0 of 10 pairs, "
        "p 0.0039 after Holm over 2 tests"
    )
    pair = first(against(runs(random=CLEAR["mine"], mine=CLEAR["random"]), "random"))
    assert pair.verdict.startswith("fewer certified causes than random: 0.49x")
    assert pair.verdict.endswith(", which is worse")


def test_where_none_is_shown_it_says_so():
    pair = first(against(runs(random=[4, 5, 6, 5, 4] * 2, mine=[5, 4, 6, 5, 5] * 2), "random"))
    assert pair.verdict.startswith("no difference shown from random in certified causes: 1x (")
    assert "more in 4 and fewer in 2 of 10 pairs, p 1 after" in pair.verdict


def test_too_few_repeats_are_said_to_be_so_whatever_they_show():
    pair = first(against(runs(random=[1, 2, 1], mine=[9, 8, 9], other=[1, 1, 1]), "random"))
    assert "3 repeats are too few to tell, p is never below 1; 8 could (6.5x (" in pair.verdict


def test_a_single_repeat_is_said_in_the_singular():
    pair = first(against(runs(random=[1], mine=[9]), "random"))
    assert "1 repeat is too few to tell" in pair.verdict
    assert "of 1 pair)" in pair.verdict


def test_where_the_reference_finds_nothing_there_is_no_ratio():
    pair = first(against(runs(random=[0] * 10, mine=CLEAR["mine"]), "random"))
    assert pair.ratio is None
    assert "than random: more in 10" in pair.verdict


def test_p_values_are_corrected_for_every_strategy_in_every_measure():
    alone, among = against(runs(**CLEAR), "random"), against(runs(**CLEAR, other=[5] * 10), "random")
    assert (len(alone), len(among)) == (2, 4)
    assert first(alone).p_holm == pytest.approx(len(alone) * first(alone).test.p)
    assert first(among).p_holm == pytest.approx(len(among) * first(among).test.p)


def test_what_a_strategy_does_not_tell_is_not_tested():
    of_both = {"random": [counted("random", 0, None)], "mine": [counted("mine", 0, 4)]}
    assert [pair.measure for pair in against(of_both, "random")] == ["failures"]
    assert against({"random": of_both["random"]}, "random") == []
