"""A regression test as tables, JSON, Markdown, and JUnit XML."""

import re
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as Xml

from vlafuzz.common.files import write_whole, writing
from vlafuzz.common.text import Row, markdown_table, markdown_text, points
from vlafuzz.failures.corpus.bisect import Bisection
from vlafuzz.failures.corpus.diff import ORDER, Difference
from vlafuzz.failures.corpus.pairs import GROUPS, Change, Compared, Group
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
_UNPRINTABLE = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")  # XML 1.0, section 2.2
# JUnit's element for a standing in a scene that is no control; one that passes has none.
_ELEMENTS = {"error": "error", **dict.fromkeys(("invalid", "fails", "worse", "not run"), "skipped")}
_COUNTS = {"failure": "failures", "error": "errors", "skipped": "skipped"}
SHOWN = 20  # rows of a Markdown table


def tables(compared: Comparison) -> dict[str, list[Row]]:
    """The rows of every table, by title."""
    standings: list[Row] = [
        {"scenes": title} | {name: _count(compared.of(group), standing) for group, name in _GROUPS.items()}
        for standing, title in _STANDINGS.items()
    ]
    selected = [scene for scene in compared.compared if scene.probe.group != "control"]
    broken = [_scene(scene) for scene in selected if scene.standing == "worse"]
    return {
        compared.corpus: [_row(compared, group) for group in _GROUPS],
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


def document(compared: Comparison) -> dict[str, Any]:
    """The JSON of ``regress --json``."""
    names = ("corpus", "policy", "baseline", "alarm", "verdict", "alpha", "p_value", "needed", "stopped")
    between = compared.difference
    return {
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


def write_junit(comparison: Comparison, path: Path) -> None:
    """Write atomically: a scene is a test case, its group the class; all controls are one.

    Only an alarm is a failure, that of the controls. Another scene in which the policy fails is skipped, with a
    message; there, failures raise no alarm.
    """
    report = Xml.Element("testsuites", name="vlafuzz regress")
    seconds = sum(control.seconds for control in comparison.of("control"))
    element = "failure" if comparison.alarm else "" if comparison.tells else "error"
    name = f"fails no more often than {comparison.baseline}"
    verdict = _element("control", name, element, comparison.verdict, seconds)
    for group in GROUPS:
        cases = [verdict] if group == "control" else [_case(scene) for scene in comparison.of(group)]
        suite = Xml.SubElement(report, "testsuite", _counts(cases), name=group)
        properties = Xml.SubElement(suite, "properties")
        for field in ("policy", "baseline", "verdict", "changes"):
            Xml.SubElement(properties, "property", name=field, value=_clean(getattr(comparison, field)))
        suite.extend(cases)
    report.attrib |= _counts(list(report.iter("testcase")))
    Xml.indent(report)
    with writing(path, "give --junit another place"):
        write_whole(path, bytes(Xml.tostring(report, encoding="utf-8", xml_declaration=True)))


def _element(of: str, name: str, element: str, message: str, seconds: float) -> Xml.Element:
    """A test case that passes, or has an element with a message."""
    case = Xml.Element("testcase", classname=of, name=_clean(name), time=f"{seconds:.3f}")
    if element:
        Xml.SubElement(case, element, message=_clean(message))
    return case


def _case(scene: Compared) -> Xml.Element:
    probe, judged = scene.probe, len(scene.judged)
    counts = f"passed {scene.policy_passed} of {judged}, the baseline {scene.baseline_passed} of {judged}"
    messages = {
        "worse": f"broken: {counts}",
        "fails": f"the baseline fails, too: {counts}",
        "not run": "not run: the comparison stopped before",
    }
    message = messages.get(scene.standing, scene.standing) + (f"; {scene.detail}" if scene.detail else "")
    name, element = f"{probe.scene.digest}: {probe.what}", _ELEMENTS.get(scene.standing, "")
    return _element(probe.group, name, element, message, scene.seconds)


def _counts(cases: Sequence[Xml.Element]) -> dict[str, str]:
    kinds = {name: str(sum(case.find(kind) is not None for case in cases)) for kind, name in _COUNTS.items()}
    seconds = sum(float(case.attrib["time"]) for case in cases)
    return {"tests": str(len(cases)), **kinds, "time": f"{seconds:.3f}"}


def _clean(text: str) -> str:
    """A text without what XML cannot hold."""
    return _UNPRINTABLE.sub("?", text)


def write_summary(comparison: Comparison, path: Path, still: bytes | None) -> None:
    """Write Markdown atomically: the verdict, the tables, and a picture beside it with the same name.

    Args:
        still: JPEG of a scene that the policy broke.

    Raises:
        UsageError: the system refuses to write it.
    """
    picture = path.with_suffix(".jpg")
    sign = "❌" if comparison.alarm else "✅" if comparison.tells else "❔"
    parts = [
        f"## {sign} {markdown_text(comparison.verdict)}",
        markdown_text(comparison.changes),
        difference(comparison),
        f"![a scene in which only the policy fails]({picture.name})" if still is not None else "",
    ]
    for title, rows in tables(comparison).items():
        left = f"\n\n… and {len(rows) - SHOWN} more" if len(rows) > SHOWN else ""
        parts.append(f"### {markdown_text(title)}\n\n{markdown_table(rows[:SHOWN])}{left}")
    with writing(path, hint="give --summary another place"):
        if still is not None:
            write_whole(picture, still)
        write_whole(path, "\n\n".join(filter(None, parts)) + "\n")
