"""A regression test as tables and JSON."""

from dataclasses import asdict
from typing import Any

from vlafuzz.common.text import Row, points
from vlafuzz.failures.corpus.bisect import Bisection
from vlafuzz.failures.corpus.corpus import Corpus
from vlafuzz.failures.corpus.diff import ORDER, Difference
from vlafuzz.failures.corpus.pairs import Change, Compared, Group
from vlafuzz.failures.corpus.regress import Comparison

_GROUPS: dict[Group, str] = {
    "control": "controls",
    "failing": "failing scenes",
    "counterpart": "counterparts",
    "nominal": "nominal scenes",
}
_STANDINGS = {
    "better": "fixed: the baseline fails, the policy passes",
    "worse": "broken: the baseline passes, the policy fails",
    "passes": "both pass",
    "fails": "both fail",
    "error": "errors: a policy or the simulator broke",
    "invalid": "invalid: no longer fair",
    "not run": "not run",
}


def tables(compared: Comparison, corpus: Corpus) -> dict[str, list[Row]]:
    """The rows of every table, by title."""
    standings: list[Row] = [
        {"scenes": title} | {name: _count(compared.of(group), standing) for group, name in _GROUPS.items()}
        for standing, title in _STANDINGS.items()
    ]
    selected = [scene for scene in compared.compared if scene.probe.group != "control"]
    broken = [_scene(scene) for scene in selected if scene.standing == "worse"]
    return {
        corpus.name: [_row(compared, group) for group in _GROUPS],
        "how the policy stands": standings,
        **({"broken, which raises no alarm": broken} if broken else {}),
    }


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


def _count(scenes: list[Compared], standing: str) -> int:
    return sum(scene.standing == standing for scene in scenes)


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


def document(compared: Comparison, corpus: Corpus) -> dict[str, Any]:
    """The JSON of ``regress --json``."""
    names = ("policy", "baseline", "alarm", "verdict", "alpha", "p_value", "needed", "stopped")
    between = compared.difference
    return {
        "corpus": corpus.name,
        **{name: getattr(compared, name) for name in names},
        "controls": compared.tried,
        "judged": compared.controls.policy.of,
        "fixed": _change(compared.fixed),
        "broken": _change(compared.broken),
        "changes": compared.changes,
        "difference": between and {"of_failure_rates": compared.lost, **between._asdict()},
        "groups": {
            group: {
                "scenes": len(scenes := compared.of(group)),
                **asdict(compared.tally(group)),
                "standings": {name: _count(scenes, name) for name in _STANDINGS},
            }
            for group in _GROUPS
        },
        "scenes": [_scene(scene) | {"standing": scene.standing} for scene in compared.compared],
    }


def _change(change: Change) -> dict[str, Any]:
    return {**asdict(change), "shown": change.shown}


def difference_rows(result: Difference) -> list[Row]:
    """One row for each cause."""
    return [
        {
            "cause": change.title,
            "standing": change.standing,
            "passes now": f"{change.passes} of {change.scenes}",
            "scene": change.scene[:12],
            "signature": change.signature,
        }
        for change in result.causes
    ]


def difference_document(result: Difference) -> dict[str, Any]:
    """The JSON of ``diff --json``."""
    tests = {name: _change(getattr(result, name)) for name in ("fixed", "broken", "new")}
    counts = {standing: len(result.of(standing)) for standing in ORDER}
    names = {"first": result.first, "second": result.second, "verdict": result.verdict}
    return {**names, "counts": counts, **tests, "causes": [asdict(change) for change in result.causes]}


def bisection_document(result: Bisection, corpus: Corpus) -> dict[str, Any]:
    """The JSON of ``bisect --json``."""
    names = ("baseline", "alarm", "named", "certain", "error", "verdict", "rollouts")
    return {
        "corpus": corpus.name,
        "p_value": result.last.p_value,
        "alpha": result.last.alpha,
        **{name: getattr(result, name) for name in names},
        "probabilities": dict(zip(result.checkpoints, result.probabilities, strict=True)) if result.alarm else {},
        "shape": result.shape,
        "shapes": result.belief.shapes if result.alarm else {},
        "in_time": result.in_time,
        "likely": [result.checkpoints[index] for index in result.likely],
        "comparisons": [asdict(step) for step in result.steps],
    }
