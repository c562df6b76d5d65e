"""Evidence in words: signatures and thresholds."""

from collections.abc import Iterable

from vlafuzz.evidence import Threshold
from vlafuzz.scene import in_words

BASE = "base"  # in a signature: even the nominal scene fails


def signature(task: str, lost: str, operators: Iterable[str]) -> str:
    """Identifies a cause, readably: ``pick-up|grasp|camera-orientation+light``."""
    return f"{task}|{lost}|{'+'.join(sorted(operators)) or BASE}"


def describe(threshold: Threshold) -> str:
    """The operator and its failing range: ``light: fails from intensity × 6.25 on``."""
    return f"{threshold.operator}: {failing_range(threshold)}"


def failing_range(threshold: Threshold) -> str:
    """The values from which on the policy fails."""
    values = ", ".join(in_words(path, value) for path, value in threshold.at)
    share = "" if len(threshold.at) == 1 else f" ({threshold.share:.0%} of the way)"
    return f"fails from {values}{share} on"
