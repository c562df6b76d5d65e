"""A regression test as tables and JSON."""

from dataclasses import asdict
from typing import Any

from vlafuzz.regression.corpus import Corpus
from vlafuzz.regression.pairs import Compared, Group, Tally
from vlafuzz.regression.regress import Comparison
from vlafuzz.text import Row, count_of

_GROUPS: dict[Group, str] = {
    "failing": "failing scenes",
    "counterpart": "counterparts",
    "nominal": "nominal scenes",
}
_STANDINGS = {
    "better": "solved: only the policy passes",
    "worse": "broken: only the baseline passes",
    "passes": "both pass",
    "fails": "both fail",
    "error": "errors: a policy or the simulator broke",
    "invalid": "invalid: no longer fair",
    "not run": "not run",
}


def tables(compared: Comparison, corpus: Corpus) -> dict[str, list[Row]]:
    """The rows of every table, by title."""
    groups = [_row(name, compared.tally(group), len(compared.of(group))) for group, name in _GROUPS.items()]
    standings: list[Row] = [
        {"scenes": title} | {name: _count(compared.of(group), standing) for group, name in _GROUPS.items()}
        for standing, title in _STANDINGS.items()
    ]
    worse = [_scene(scene) for scene in compared.compared if scene.standing == "worse"]
    return {
        corpus.name: [*groups, _row("all", compared.total, len(compared.compared))],
        "how the policy stands": standings,
        **({"got worse": worse} if worse else {}),
    }


def _row(group: str, tally: Tally, scenes: int) -> Row:
    return {
        "group": group,
        "scenes": scenes,
        "baseline passed": count_of(**asdict(tally.baseline)),
        "policy passed": count_of(**asdict(tally.policy)),
        "worse": tally.worse,
        "better": tally.better,
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
    total = compared.total
    names = ("policy", "baseline", "alarm", "verdict", "alpha", "p_value", "needed", "stopped")
    return {
        "corpus": corpus.name,
        **{name: getattr(compared, name) for name in names},
        "pairs": compared.tried,
        "judged": total.baseline.of,
        "groups": {group: _group(compared, group) for group in _GROUPS},
        "total": asdict(total),
        "scenes": [_scene(scene) | {"standing": scene.standing} for scene in compared.compared],
    }


def _group(compared: Comparison, group: Group) -> dict[str, Any]:
    scenes = compared.of(group)
    standings = {name: _count(scenes, name) for name in _STANDINGS}
    return {"scenes": len(scenes), **asdict(compared.tally(group)), "standings": standings}
