"""A comparison as JUnit XML, which continuous integration shows."""

import re
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree as Xml

from vlafuzz.common.files import write_whole, writing
from vlafuzz.failures.corpus.pairs import GROUPS, Compared, Group
from vlafuzz.failures.corpus.regress import Comparison

_UNPRINTABLE = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")  # XML 1.0, section 2.2
# JUnit's element for a standing in a scene that is no control; one that passes has none.
_SKIPPED = dict.fromkeys(("invalid", "fails", "worse", "not run"), "skipped")
_ELEMENTS = {"error": "error", **_SKIPPED}
_COUNTS = {"failure": "failures", "error": "errors", "skipped": "skipped"}


def write_junit(comparison: Comparison, path: Path) -> None:
    """Write atomically: a scene is a test case, its group the class; all controls are one.

    Only an alarm is a failure, that of the controls. Another scene in which the policy fails is skipped, with
    a message; there, failures raise no alarm.
    """
    with writing(path, "give --junit another place"):
        write_whole(path, Xml.tostring(_report(comparison), encoding="utf-8", xml_declaration=True))


def _report(comparison: Comparison) -> Xml.Element:
    suites = [_suite(comparison, group) for group in GROUPS]
    cases = [case for suite in suites for case in suite.findall("testcase")]
    report = Xml.Element("testsuites", counts(cases), name="vlafuzz regress")
    report.extend(suites)
    Xml.indent(report)
    return report


def _suite(comparison: Comparison, group: Group) -> Xml.Element:
    cases = [_verdict(comparison)] if group == "control" else [_case(scene) for scene in comparison.of(group)]
    suite = Xml.Element("testsuite", counts(cases), name=group)
    properties = Xml.SubElement(suite, "properties")
    for name in ("policy", "baseline", "verdict", "changes"):
        Xml.SubElement(properties, "property", name=name, value=clean(getattr(comparison, name)))
    suite.extend(cases)
    return suite


def _verdict(comparison: Comparison) -> Xml.Element:
    seconds = sum(control.seconds for control in comparison.of("control"))
    name = clean(f"fails no more often than {comparison.baseline}")
    case = Xml.Element("testcase", classname="control", name=name, time=f"{seconds:.3f}")
    if comparison.alarm or not comparison.tells:
        element = "failure" if comparison.alarm else "error"
        Xml.SubElement(case, element, message=clean(comparison.verdict))
    return case


def _case(scene: Compared) -> Xml.Element:
    probe = scene.probe
    case = Xml.Element(
        "testcase",
        classname=probe.group,
        name=clean(f"{probe.scene.digest}: {probe.what}"),
        time=f"{scene.seconds:.3f}",
    )
    if scene.standing in _ELEMENTS:
        Xml.SubElement(case, _ELEMENTS[scene.standing], message=clean(_message(scene)))
    return case


def _message(scene: Compared) -> str:
    judged = len(scene.judged)
    counts = f"passed {scene.policy_passed} of {judged}, the baseline {scene.baseline_passed} of {judged}"
    messages = {
        "worse": f"broken: {counts}",
        "fails": f"the baseline fails, too: {counts}",
        "not run": "not run: the comparison stopped before",
    }
    detail = f"; {scene.detail}" if scene.detail else ""
    return messages.get(scene.standing, scene.standing) + detail


def counts(cases: Sequence[Xml.Element]) -> dict[str, str]:
    """Attributes of a suite with these cases."""
    kinds = {name: str(sum(case.find(kind) is not None for case in cases)) for kind, name in _COUNTS.items()}
    seconds = sum(float(case.attrib["time"]) for case in cases)
    return {"tests": str(len(cases)), **kinds, "time": f"{seconds:.3f}"}


def clean(text: str) -> str:
    """A text without what XML cannot hold."""
    return _UNPRINTABLE.sub("?", text)
