"""What is fixed and what is broken, and when it is shown to be."""

import numpy as np
import pytest

from tests.failures.corpus.sides import Planned, flaky, probes
from vlafuzz.failures.corpus.regress import Comparison, Recorded, compare
from vlafuzz.model.outcome import Verdict

RECORDED = Recorded("old as recorded")
CONTROLS, SELECTED = 20, 10  # failing scenes have the numbers 20 to 29, counterparts 30 to 39


def compared(rule, baseline=RECORDED) -> Comparison:
    return compare(probes(CONTROLS, SELECTED), Planned(rule), baseline)


def repaired(number: int, repeat: int) -> bool:
    return number % 5 > 0 or number >= CONTROLS


def as_before(number: int, repeat: int) -> bool:
    return number >= 30 or (number < CONTROLS and number % 5 > 0)


def elsewhere(number: int, repeat: int) -> bool:
    """Repaired in the controls, where the corpus has no failing scene."""
    return not 20 <= number < 30


def test_a_policy_whose_fault_is_repaired_fixes_all_and_breaks_nothing():
    result = compared(repaired)
    assert (result.fixed.changed, result.fixed.of, result.broken.changed, result.broken.of) == (10, 10, 0, 10)
    assert (result.fixed.shown, result.broken.shown) == (True, False)
    assert result.fixed.p_value == pytest.approx(8.0**-10)
    assert result.changes == (
        "failures are fixed: 10 of 10 failing scenes fixed (p = 9.3e-10), "
        "0 of 10 passing scenes beside them broken (p = 1)"
    )


@pytest.mark.parametrize("rule", [as_before, elsewhere])
def test_a_policy_that_is_repaired_elsewhere_or_nowhere_fixes_nothing(rule):
    result = compared(rule)
    assert (result.fixed.changed, result.fixed.p_value, result.broken.p_value) == (0, 1, 1)
    assert result.changes.startswith("nothing is shown to be fixed or broken: 0 of 10 failing scenes fixed")


def test_the_other_direction_a_policy_that_breaks_what_passed():
    result = compared(lambda number, repeat: number < CONTROLS and number % 5 > 0)
    assert (result.alarm, result.fixed.shown, result.broken.shown) == (False, False, True)
    assert "passing scenes are broken: 0 of 10 failing scenes fixed" in result.changes
    assert "10 of 10 passing scenes beside them broken (p = 9.3e-10)" in result.changes


def test_one_that_trades_them_does_both():
    result = compared(lambda number, repeat: number < 30 and (number >= CONTROLS or number % 5 > 0))
    assert result.changes.startswith("failures are fixed and passing scenes are broken: 10 of 10")


def test_few_scenes_that_mostly_pass_are_counted_but_not_shown():
    result = compared(lambda number, repeat: as_before(number, repeat) or (number in (20, 21) and repeat > 0))
    assert (result.fixed.changed, result.fixed.shown) == (2, False)


def test_what_was_not_judged_does_not_count():
    result = compared(lambda number, repeat: Verdict.ERROR if number >= 25 else repaired(number, repeat))
    assert (result.fixed.of, result.broken.of) == (5, 0)
    nothing = compare(probes(CONTROLS), Planned(as_before), RECORDED)
    assert nothing.changes == ""


def test_against_a_baseline_that_is_rolled_out_both_directions_are_a_sign_test():
    old = Planned(as_before, name="old")
    result = compared(repaired, old)
    assert (result.fixed.changed, result.fixed.of) == (10, 10)
    assert result.fixed.p_value == pytest.approx(2.0**-30)
    back = compare(probes(CONTROLS, SELECTED), Planned(as_before), Planned(repaired, name="old"))
    assert (back.fixed.changed, back.fixed.of, back.fixed.p_value) == (0, 0, 1)


@pytest.mark.parametrize("rate", [0.5, 0.7])
def test_a_policy_that_still_mostly_fails_is_hardly_ever_said_to_fix(rate: float):
    """And one that still mostly passes hardly ever to break."""
    rng = np.random.default_rng(0)
    old = [probe for probe in probes(0, 20) if probe.group == "failing"]
    shown = [compare(old, flaky(rate, rng), RECORDED).fixed.shown for _ in range(300)]
    assert np.mean(shown) <= 0.07
    passing = [probe for probe in probes(0, 20) if probe.group == "counterpart"]
    shown = [compare(passing, flaky(1 - rate, rng), RECORDED).broken.shown for _ in range(300)]
    assert np.mean(shown) <= 0.07
