"""A comparison as JUnit XML, which continuous integration shows scene by scene."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path
from xml.etree import ElementTree as Xml

from vlafuzz.errors import UsageError
from vlafuzz.regression.pairs import GROUPS, Compared, Group
from vlafuzz.regression.regress import Comparison

_UNPRINTABLE = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")  # XML 1.0, section 2.2
# What a scene is in JUnit's words; one that passes is none of them.
_ELEMENTS = {
    "worse": "failure",
    "error": "error",
    "invalid": "skipped",
    "fails": "skipped",
    "not run": "skipped",
}
_COUNTS = {"failure": "failures", "error": "errors", "skipped": "skipped"}


def write_junit(comparison: Comparison, path: Path) -> None:
    """Write it whole or not at all: a scene a test case, its group the class.

    A scene fails where the policy passes less often than the baseline, and is skipped where the baseline
    fails, too: that is known. One such scene is no alarm yet; the verdict over all is a property.

    Raises:
        UsageError: the file cannot be written.
    """
    unfinished = path.with_name(f".{path.name}.part")
    try:
        unfinished.write_bytes(Xml.tostring(_report(comparison), encoding="utf-8", xml_declaration=True))
        unfinished.replace(path)
    except OSError as error:
        reason = (error.strerror or "unknown reason").lower()
        raise UsageError(f"{path}: cannot be written: {reason}", hint="give --junit elsewhere") from None
    finally:
        unfinished.unlink(missing_ok=True)


def _report(comparison: Comparison) -> Xml.Element:
    report = Xml.Element("testsuites", _counts(comparison.compared), name="vlafuzz regress")
    for group in GROUPS:
        report.append(_suite(comparison, group))
    Xml.indent(report)
    return report


def _suite(comparison: Comparison, group: Group) -> Xml.Element:
    scenes = comparison.of(group)
    suite = Xml.Element("testsuite", _counts(tuple(scenes)), name=group)
    properties = Xml.SubElement(suite, "properties")
    for name in ("policy", "baseline", "verdict"):
        Xml.SubElement(properties, "property", name=name, value=_clean(getattr(comparison, name)))
    for each in scenes:
        suite.append(_case(each))
    return suite


def _case(each: Compared) -> Xml.Element:
    probe = each.probe
    case = Xml.Element(
        "testcase",
        classname=probe.group,
        name=_clean(f"{probe.scene.digest}: {probe.what}"),
        time=f"{each.seconds:.3f}",
    )
    if each.standing in _ELEMENTS:
        Xml.SubElement(case, _ELEMENTS[each.standing], message=_clean(_message(each)))
    return case


def _message(each: Compared) -> str:
    judged = len(each.judged)
    counts = f"passed {each.policy_passed} of {judged}, the baseline {each.baseline_passed} of {judged}"
    said = {
        "worse": counts,
        "fails": f"the baseline fails, too: {counts}",
        "not run": "not run: stopped before",
    }
    detail = f"; {each.detail}" if each.detail else ""
    return said.get(each.standing, each.standing) + detail


def _counts(scenes: tuple[Compared, ...]) -> dict[str, str]:
    kinds = Counter(_ELEMENTS.get(each.standing) for each in scenes)
    counts = {name: str(kinds[element]) for element, name in _COUNTS.items()}
    return {"tests": str(len(scenes)), **counts, "time": f"{sum(each.seconds for each in scenes):.3f}"}


def _clean(text: str) -> str:
    return _UNPRINTABLE.sub("?", text)
