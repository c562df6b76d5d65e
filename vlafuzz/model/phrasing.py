"""Evidence in words: signatures and thresholds."""

from collections.abc import Iterable, Mapping

from vlafuzz.model.evidence import Causes, Threshold, Values
from vlafuzz.model.quantities import Mechanism, Quantity
from vlafuzz.model.scene import amount, in_words

BASE = "base"  # in a signature: even the nominal scene fails


def signature(task: str, lost: str, operators: Iterable[str]) -> str:
    """Identifies a cause: ``pick-up|grasp|camera-orientation:+yaw+light:dark``, with the direction of each operator."""
    return f"{task}|{lost}|{'+'.join(sorted(operators)) or BASE}"


def describe(threshold: Threshold) -> str:
    """The operator and its failing range: ``light: fails from intensity × 6.25 (× 5.9 to × 6.6) on``."""
    return f"{threshold.operator}: {failing_range(threshold)}"


def titled(operators: Iterable[str], causes: Causes) -> str:
    """Operators in a few words, with their thresholds where these are known."""
    thresholds = {threshold.operator: describe(threshold) for threshold in causes.thresholds}
    return "; ".join(thresholds.get(name, name) for name in operators)


def failing_range(threshold: Threshold) -> str:
    """The values that fail: ``fails from yaw 2.1° (2° to 2.2°) to 3.4° and from 4° on``."""
    first, *others = threshold.fails
    start = ", ".join(in_words(path, at, threshold.operator) + _interval(threshold, path) for path, at in threshold.at)
    whole = len(threshold.at) == 1 or threshold.share == 1
    share = "" if whole else f" ({threshold.share:.0%} of the way to the failure)"
    parts = [_range(start + share, *first), *(_range(_amounts(low), low, high) for low, high in others)]
    return f"fails {' and '.join(parts)}"


def acting(mechanism: Mechanism, quantity: Quantity) -> str:
    """What it is and how it comes about: ``the target appears ≥ 11 px lower than usual (camera-position -z or …)``."""
    *others, last = mechanism.ways
    ways = f"{', '.join(others)} or {last}" if others else last
    shown = "; shown by a swap" if mechanism.swapped else ""
    return f"{quantity.says(mechanism.threshold, above=mechanism.above)} ({ways}{shown})"


def beyond(low: Values, high: Values, usual: Mapping[str, float], *, away: bool = False) -> str:
    """A range that fails, as a sentence goes on: ``at least × 5.66``, ``2.1° to 3.4°``.

    Args:
        high: none for a range that reaches as far as the operator does.
        usual: the values from which they differ, by path.
        away: the sentence tells the direction, so that amounts are without their sign.
    """
    if away:
        low, high = (tuple((path, abs(value)) for path, value in values) for values in (low, high))
    if high:
        return _amounts(low) if low == high else f"{_amounts(low)} to {_amounts(high)}"
    if len(low) > 1:
        return f"{_amounts(low)} or beyond"
    ((path, value),) = low
    return f"at {'least' if away or value > usual[path] else 'most'} {_amounts(low)}"


def _range(start: str, low: Values, high: Values) -> str:
    if not high:
        return f"from {start} on"
    return f"at {start}" if low == high else f"from {start} to {_amounts(high)}"


def _amounts(values: Values) -> str:
    """Values as they continue a sentence: one without its name."""
    if len(values) == 1:
        return amount(*values[0])
    return ", ".join(in_words(path, value) for path, value in values)


def _interval(threshold: Threshold, path: str) -> str:
    if not threshold.low or threshold.low == threshold.high:
        return ""
    ends = dict(threshold.low)[path], dict(threshold.high)[path]
    wraps = abs(ends[1] - ends[0]) > 180  # at ±180°: 178° to -176°
    low, high = sorted(ends, reverse=wraps)
    return f" ({amount(path, low)} to {amount(path, high)})"
