"""Comparisons of policies as tables and JSON."""

from dataclasses import asdict
from typing import Any, get_args

from vlafuzz.common.text import Row, points
from vlafuzz.failures.corpus.bisect import Bisection
from vlafuzz.failures.corpus.diff import ORDER, Difference
from vlafuzz.failures.corpus.pairs import Compared, Fixed, Group, Standing
from vlafuzz.failures.corpus.regress import Comparison

_GROUPS: dict[Group, str] = {"control": "controls", "failing": "failing scenes"}


def tables(compared: Comparison) -> dict[str, list[Row]]:
    """The rows of every table, by title."""
    groups = [_row(compared, group) for group in _GROUPS]
    broken = [_scene(scene) for scene in compared.compared if scene.standing == "worse"]
    return {compared.corpus: groups, **({"broken: only the policy fails": broken} if broken else {})}


def difference(compared: Comparison) -> str:
    """The difference of the failure rates in a sentence; empty where no control was judged."""
    between = compared.difference
    if between is None:
        return ""
    span = f"{points(between.low)} to {points(between.high)}"
    biased = "; biased upward, because the test stopped at the alarm: see --whole"
    all_run = compared.tried == len(compared.of("control"))
    early = biased if compared.stopped == "worse" and not all_run else ""
    return f"failure rate over controls: {points(compared.lost)} points ({span}){early}"


def _row(compared: Comparison, group: Group) -> Row:
    """A group in numbers; only controls are random, so that the interval of a rate is theirs alone."""
    tally = compared.tally(group)
    baseline, policy = (
        str(share) if group == "control" else f"{share.count} of {share.of}" for share in (tally.baseline, tally.policy)
    )
    return {
        "group": _GROUPS[group],
        "scenes": len(compared.of(group)),
        "rollouts": tally.policy.of,
        "baseline passes": baseline,
        "policy passes": policy,
        "broken": tally.worse,
        "fixed": tally.better,
    }


def _scene(scene: Compared) -> Row:
    judged = len(scene.judged)
    return {
        "scene": scene.probe.scene.digest,
        "group": scene.probe.group,
        "what": scene.probe.what,
        "baseline passed": f"{scene.baseline_passed} of {judged}",
        "policy passed": f"{scene.policy_passed} of {judged}",
        "why": scene.detail,
    }


def document(compared: Comparison) -> dict[str, Any]:
    """The JSON of ``regress --json``."""
    names = ("corpus", "policy", "baseline", "alarm", "verdict", "alpha", "p_value", "needed", "stopped")
    between = compared.difference
    return {
        **{name: getattr(compared, name) for name in names},
        "controls": compared.tried,
        "judged": compared.controls.policy.of,
        "fixed": _change(compared.fixed),
        "changes": compared.changes,
        "difference": between and {"of_failure_rates": compared.lost, **between._asdict()},
        "groups": {
            group: {
                "scenes": len(scenes := compared.of(group)),
                **asdict(compared.tally(group)),
                "standings": {name: sum(one.standing == name for one in scenes) for name in get_args(Standing)},
            }
            for group in _GROUPS
        },
        "scenes": [_scene(scene) | {"standing": scene.standing} for scene in compared.compared],
    }


def _change(change: Fixed) -> dict[str, Any]:
    return {**asdict(change), "shown": change.shown}


def difference_rows(result: Difference) -> list[Row]:
    """One row for each cause."""
    return [
        {
            "cause": change.title,
            "standing": change.standing,
            "passes now": f"{change.passes} of {change.scenes}",
            "scene": change.scene[:12],
        }
        for change in result.causes
    ]


def difference_document(result: Difference) -> dict[str, Any]:
    """The JSON of ``diff --json``."""
    tests = {name: _change(getattr(result, name)) for name in ("fixed", "new")}
    counts = {standing: len(result.of(standing)) for standing in ORDER}
    names = {"first": result.first, "second": result.second, "verdict": result.verdict}
    return {**names, "counts": counts, **tests, "causes": [asdict(change) for change in result.causes]}


def bisection_document(result: Bisection, corpus: str) -> dict[str, Any]:
    """The JSON of ``bisect --json``, with one row for each checkpoint that was compared."""
    names = ("alarm", "named", "certain", "error", "verdict", "probabilities", "likely", "shape", "shapes", "in_time")
    return {
        "corpus": corpus,
        **{name: getattr(result.last, name) for name in ("baseline", "p_value", "alpha")},
        **{name: getattr(result, name) for name in names},
        "rollouts": sum(result.ran),
        "compared": [
            {
                "checkpoint": result.checkpoints[index],
                "controls": int((judged := result.judged(index)).sum()),
                "baseline_passed": int(result.of_baseline[judged].sum()),
                "passed": int(result.outcomes[index, judged].sum()),
                "broken": result.broken(index),
            }
            for index, ran in enumerate(result.ran)
            if ran
        ],
    }
