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


NOTHING = "nothing is shown to be fixed or broken: "
RULES = {
    "repaired": (repaired, "failures are fixed: ", 10, 0),
    "as before": (as_before, NOTHING, 0, 0),
    "repaired elsewhere": (elsewhere, NOTHING, 0, 0),
    "breaks what passed": (lambda n, _: n < CONTROLS and n % 5 > 0, "passing scenes are broken: ", 0, 10),
    "trades": (
        lambda n, _: n < 30 and (n >= CONTROLS or n % 5 > 0),
        "failures are fixed and passing scenes are broken: ",
        *(10, 10),
    ),
    "mostly passes two": (lambda n, repeat: as_before(n, repeat) or (n in (20, 21) and repeat > 0), NOTHING, 2, 0),
}
P_VALUES = {0: "1", 2: "1", 10: "9.3e-10"}  # of so many of ten scenes; two that fail once in three show nothing


@pytest.mark.parametrize("rule", RULES)
def test_what_is_fixed_and_what_is_broken_is_counted_and_said_where_it_is_shown(rule):
    rule, says, fixed, broken = RULES[rule]
    result = compared(rule)
    assert (result.fixed.changed, result.fixed.of, result.broken.changed, result.broken.of) == (fixed, 10, broken, 10)
    assert (result.fixed.shown, result.broken.shown, result.alarm) == (fixed == 10, broken == 10, False)
    assert result.changes == (
        f"{says}{fixed} of 10 failing scenes fixed (p = {P_VALUES[fixed]}), "
        f"{broken} of 10 passing scenes beside them broken (p = {P_VALUES[broken]})"
    )


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
