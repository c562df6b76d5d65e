"""Milder scenes: the part of the ranges in which a policy that rarely passes does so more often."""

from collections.abc import Sequence
from statistics import median

from vlafuzz.common.statistics import newcombe
from vlafuzz.model.scene import Scene
from vlafuzz.model.space import Space

NAMED = 2  # operators
Row = tuple[float, bool]  # a severity, and whether the policy passed


def suggest_ranges(space: Space, outcomes: Sequence[tuple[Scene, bool]]) -> str:
    """A hint where a policy passes too few random scenes, with what was seen in these.

    The operators are named that make the most of a difference, if it is more than chance: the policy passes
    more of the scenes with the milder half of one.

    Args:
        outcomes: random scenes, at least one, and whether the policy passed.
    """
    severities = [space.severities(scene) for scene, _ in outcomes]
    verdicts = [passed for _, passed in outcomes]
    rows = sorted(zip((sum(each.values()) for each in severities), verdicts, strict=True))
    seen = f"the policy passes {_count(rows[: (len(rows) + 3) // 4])} scenes nearest to nominal"
    found: list[tuple[float, str, str]] = []
    for operator in sorted(space.operators.varied):
        values = [each.get(operator, 0.0) for each in severities]
        middle, rows = median(values), list(zip(values, verdicts, strict=True))
        mild, severe = [row for row in rows if row[0] <= middle], [row for row in rows if row[0] > middle]
        gain = newcombe(_passed(mild), len(mild), _passed(severe), len(severe)).low if severe else 0.0
        if gain > 0:
            halves = f"{_count(mild)} with the milder half of {operator} (else {_count(severe)})"
            found.append((gain, operator, halves))
    decisive = sorted(found, reverse=True)[:NAMED]
    rest = space.operators.varied - {operator for _, operator, _ in decisive}
    vary = f"--vary {','.join(sorted(rest))}" if decisive and rest else "fewer operators (--vary)"
    counts = ", ".join([seen, *(halves for *_, halves in decisive)])
    return f"{counts}; run again in narrower ranges (--operators FILE) or with {vary}"


def _passed(rows: Sequence[Row]) -> int:
    return sum(passed for _, passed in rows)


def _count(rows: Sequence[Row]) -> str:
    return f"{_passed(rows)} of {len(rows)}"
