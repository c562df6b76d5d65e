"""A comparison as files that continuous integration shows: JUnit XML and Markdown."""

import re
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree as Xml

from vlafuzz.common.files import write_whole, writing
from vlafuzz.common.text import markdown_table, markdown_text
from vlafuzz.failures.corpus.corpus import Corpus
from vlafuzz.failures.corpus.pairs import GROUPS, Compared
from vlafuzz.failures.corpus.regress import Comparison
from vlafuzz.failures.corpus.tables import difference, tables

_UNPRINTABLE = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")  # XML 1.0, section 2.2
# JUnit's element for a standing in a scene that is no control; one that passes has none.
_ELEMENTS = {"error": "error", **dict.fromkeys(("invalid", "fails", "worse", "not run"), "skipped")}
_COUNTS = {"failure": "failures", "error": "errors", "skipped": "skipped"}
SHOWN = 20  # rows of a Markdown table


def write_junit(comparison: Comparison, path: Path) -> None:
    """Write atomically: a scene is a test case, its group the class; all controls are one.

    Only an alarm is a failure, that of the controls. Another scene in which the policy fails is skipped, with a
    message; there, failures raise no alarm.
    """
    suites = []
    for group in GROUPS:
        scenes = comparison.of(group)
        cases = [_verdict(comparison)] if group == "control" else [_case(scene) for scene in scenes]
        suites.append(suite(group, cases, comparison))
    with writing(path, "give --junit another place"):
        write_whole(path, junit("vlafuzz regress", suites))


def junit(name: str, suites: Sequence[Xml.Element]) -> bytes:
    """A report of suites."""
    cases = [case for each in suites for case in each.findall("testcase")]
    report = Xml.Element("testsuites", _counts(cases), name=name)
    report.extend(suites)
    Xml.indent(report)
    return bytes(Xml.tostring(report, encoding="utf-8", xml_declaration=True))


def suite(name: str, cases: Sequence[Xml.Element], comparison: Comparison | None = None) -> Xml.Element:
    """Test cases with their counts, and the properties of a comparison."""
    made = Xml.Element("testsuite", _counts(cases), name=clean(name))
    if comparison is not None:
        properties = Xml.SubElement(made, "properties")
        for field in ("policy", "baseline", "verdict", "changes"):
            Xml.SubElement(properties, "property", name=field, value=clean(getattr(comparison, field)))
    made.extend(cases)
    return made


def junit_case(of: str, name: str, element: str = "", message: str = "", seconds: float = 0.0) -> Xml.Element:
    """A case that passes, or has an element with a message."""
    case = Xml.Element("testcase", classname=clean(of), name=clean(name), time=f"{seconds:.3f}")
    if element:
        Xml.SubElement(case, element, message=clean(message))
    return case


def _verdict(comparison: Comparison) -> Xml.Element:
    seconds = sum(control.seconds for control in comparison.of("control"))
    element = "failure" if comparison.alarm else "" if comparison.tells else "error"
    name = f"fails no more often than {comparison.baseline}"
    return junit_case("control", name, element, comparison.verdict, seconds)


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
    return junit_case(probe.group, name, element, message, scene.seconds)


def _counts(cases: Sequence[Xml.Element]) -> dict[str, str]:
    kinds = {name: str(sum(case.find(kind) is not None for case in cases)) for kind, name in _COUNTS.items()}
    seconds = sum(float(case.attrib["time"]) for case in cases)
    return {"tests": str(len(cases)), **kinds, "time": f"{seconds:.3f}"}


def clean(text: str) -> str:
    """A text without what XML cannot hold."""
    return _UNPRINTABLE.sub("?", text)


def write_summary(comparison: Comparison, corpus: Corpus, path: Path, still: bytes | None) -> None:
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
    for title, rows in tables(comparison, corpus).items():
        left = f"\n\n… and {len(rows) - SHOWN} more" if len(rows) > SHOWN else ""
        parts.append(f"### {markdown_text(title)}\n\n{markdown_table(rows[:SHOWN])}{left}")
    with writing(path, hint="give --summary another place"):
        if still is not None:
            write_whole(picture, still)
        write_whole(path, "\n\n".join(filter(None, parts)) + "\n")
