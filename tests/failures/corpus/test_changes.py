"""What is fixed, and when it is shown to be."""

import numpy as np
import pytest

from tests.failures.corpus.sides import Planned, flaky, probes
from vlafuzz.failures.corpus.regress import Comparison, Recorded, compare
from vlafuzz.model.outcome import Verdict

RECORDED = Recorded("old as recorded")
CONTROLS, FAILING = 20, 10  # failing scenes have the numbers 20 to 29


def compared(rule, baseline=RECORDED) -> Comparison:
    return compare(probes(CONTROLS, FAILING), Planned(rule), baseline)


def repaired(number: int, repeat: int) -> bool:
    return number % 5 > 0 or number >= CONTROLS


def as_before(number: int, repeat: int) -> bool:
    return number < CONTROLS and number % 5 > 0


def elsewhere(number: int, repeat: int) -> bool:
    """Repaired in the controls, where the corpus has no failing scene."""
    return number < CONTROLS


NOTHING = "nothing is shown to be fixed: "
RULES = {
    "repaired": (repaired, "failures are fixed: ", 10, "9.3e-10"),
    "as before": (as_before, NOTHING, 0, "1"),
    "repaired elsewhere": (elsewhere, NOTHING, 0, "1"),
    # Two that fail once in three show nothing.
    "mostly passes two": (lambda n, repeat: as_before(n, repeat) or (n in (20, 21) and repeat > 0), NOTHING, 2, "1"),
}


@pytest.mark.parametrize("rule", RULES)
def test_what_is_fixed_is_counted_and_said_where_it_is_shown(rule):
    rule, says, fixed, p_value = RULES[rule]
    result = compared(rule)
    assert (result.fixed.changed, result.fixed.of) == (fixed, 10)
    assert (result.fixed.shown, result.alarm) == (fixed == 10, False)
    assert result.changes == f"{says}{fixed} of 10 failing scenes fixed (p = {p_value})"


def test_what_was_not_judged_does_not_count():
    result = compared(lambda number, repeat: Verdict.ERROR if number >= 25 else repaired(number, repeat))
    assert result.fixed.of == 5
    nothing = compare(probes(CONTROLS), Planned(as_before), RECORDED)
    assert nothing.changes == ""


def test_against_a_baseline_that_is_rolled_out_it_is_a_sign_test():
    old = Planned(as_before, name="old")
    result = compared(repaired, old)
    assert (result.fixed.changed, result.fixed.of) == (10, 10)
    assert result.fixed.p_value == pytest.approx(2.0**-30)
    back = compare(probes(CONTROLS, FAILING), Planned(as_before), Planned(repaired, name="old"))
    assert (back.fixed.changed, back.fixed.of, back.fixed.p_value) == (0, 0, 1)


@pytest.mark.parametrize("rate", [0.5, 0.7])
def test_a_policy_that_still_mostly_fails_is_hardly_ever_said_to_fix(rate: float):
    rng = np.random.default_rng(0)
    shown = [compare(probes(0, 20), flaky(rate, rng), RECORDED).fixed.shown for _ in range(300)]
    assert np.mean(shown) <= 0.07
