"""A comparison as JUnit XML, which continuous integration shows per scene."""

import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree as Xml

from vlafuzz.errors import UsageError
from vlafuzz.files import reason, replacing
from vlafuzz.regression.pairs import GROUPS, Compared, Group
from vlafuzz.regression.regress import Comparison

_UNPRINTABLE = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")  # XML 1.0, section 2.2
# JUnit's element for a standing; a scene that passes has none.
_SKIPPED = dict.fromkeys(("invalid", "fails", "not run"), "skipped")
_ELEMENTS = {"worse": "failure", "error": "error", **_SKIPPED}
_COUNTS = {"failure": "failures", "error": "errors", "skipped": "skipped"}


def write_junit(comparison: Comparison, path: Path) -> None:
    """Write atomically: a scene is a test case, its group the class.

    A scene fails if the policy passes less often than the baseline, and is skipped if the baseline fails,
    too. One such scene raises no alarm yet; the overall verdict is a property.
    """
    try:
        with replacing(path) as unfinished:
            unfinished.write_bytes(Xml.tostring(_report(comparison), encoding="utf-8", xml_declaration=True))
    except OSError as error:
        message = f"{path}: cannot be written: {reason(error)}"
        raise UsageError(message, hint="give --junit another place") from None


def _report(comparison: Comparison) -> Xml.Element:
    report = Xml.Element("testsuites", _counts(comparison.compared), name="vlafuzz regress")
    report.extend(_suite(comparison, group) for group in GROUPS)
    Xml.indent(report)
    return report


def _suite(comparison: Comparison, group: Group) -> Xml.Element:
    scenes = comparison.of(group)
    suite = Xml.Element("testsuite", _counts(scenes), name=group)
    properties = Xml.SubElement(suite, "properties")
    for name in ("policy", "baseline", "verdict"):
        Xml.SubElement(properties, "property", name=name, value=_clean(getattr(comparison, name)))
    suite.extend(map(_case, scenes))
    return suite


def _case(scene: Compared) -> Xml.Element:
    probe = scene.probe
    case = Xml.Element(
        "testcase",
        classname=probe.group,
        name=_clean(f"{probe.scene.digest}: {probe.what}"),
        time=f"{scene.seconds:.3f}",
    )
    if scene.standing in _ELEMENTS:
        Xml.SubElement(case, _ELEMENTS[scene.standing], message=_clean(_message(scene)))
    return case


def _message(scene: Compared) -> str:
    judged = len(scene.judged)
    counts = f"passed {scene.policy_passed} of {judged}, the baseline {scene.baseline_passed} of {judged}"
    messages = {
        "worse": counts,
        "fails": f"the baseline fails, too: {counts}",
        "not run": "not run: the comparison stopped before",
    }
    detail = f"; {scene.detail}" if scene.detail else ""
    return messages.get(scene.standing, scene.standing) + detail


def _counts(scenes: Sequence[Compared]) -> dict[str, str]:
    kinds = Counter(_ELEMENTS.get(scene.standing) for scene in scenes)
    counts = {name: str(kinds[element]) for element, name in _COUNTS.items()}
    return {"tests": str(len(scenes)), **counts, "time": f"{sum(scene.seconds for scene in scenes):.3f}"}


def _clean(text: str) -> str:
    return _UNPRINTABLE.sub("?", text)
