"""What JUnit XML says about a comparison."""

from collections import Counter
from pathlib import Path
from xml.etree import ElementTree as Xml

from tests.failures.corpus.sides import Planned, probes
from vlafuzz.failures.corpus.regress import Recorded, compare
from vlafuzz.failures.corpus.tables import write_junit
from vlafuzz.model.outcome import Outcome, Verdict


def compared(rule, bound: int | None = None):
    """In ten controls, four failing scenes (10 to 13) and four counterparts (14 to 17)."""
    return compare(probes(10, 4), Planned(rule), Recorded("old"), max_rollouts=bound)


def elements(path: Path) -> dict[str, str]:
    """The element of each test case, by the name of the scene."""
    cases = Xml.parse(path).getroot().iter("testcase")
    return {case.attrib["name"].partition(": ")[2]: next((element.tag for element in case), "passed") for case in cases}


def test_a_scene_is_a_case_and_its_group_the_class_and_all_controls_are_one_case(tmp_path: Path):
    write_junit(compared(lambda number, repeat: number >= 10 or number % 5 > 0), tmp_path / "a.xml")
    root = Xml.parse(tmp_path / "a.xml").getroot()
    groups = {"control": 1, "failing": 4, "counterpart": 4, "nominal": 0}
    assert {suite.attrib["name"]: int(suite.attrib["tests"]) for suite in root} == groups
    assert Counter(case.attrib["classname"] for case in root.iter("testcase")) == Counter(groups)
    assert (root.attrib["tests"], root.attrib["failures"], root.attrib["skipped"]) == ("9", "0", "0")
    assert "not shown to be worse" in root.find(".//property[@name='verdict']").attrib["value"]


def test_only_an_alarm_is_a_failure(tmp_path: Path):
    write_junit(compared(lambda number, repeat: False), tmp_path / "a.xml")
    root = Xml.parse(tmp_path / "a.xml").getroot()
    assert (root.attrib["failures"], root.attrib["skipped"]) == ("1", "8")
    assert root.find(".//failure").attrib["message"].startswith("new is worse than old: 8 worse")


def test_broken_and_failing_scenes_are_skipped_with_a_message_and_errors_are_errors(tmp_path: Path):
    def rule(number: int, repeat: int) -> Verdict | bool:
        answers = {10: True, 15: Verdict.ERROR, 16: Verdict.INVALID, 17: True}
        return number % 5 > 0 if number < 10 else answers.get(number, False)

    write_junit(compared(rule), tmp_path / "a.xml")
    assert elements(tmp_path / "a.xml") == {
        "": "passed",
        "failing 10": "passed",
        **{f"failing {number}": "skipped" for number in (11, 12, 13)},
        "counterpart 14": "skipped",
        "counterpart 15": "error",
        "counterpart 16": "skipped",
        "counterpart 17": "passed",
    }
    broken = "broken: passed 0 of 3, the baseline 3 of 3; does not reach grasp"
    assert broken in (tmp_path / "a.xml").read_text()


def test_a_scene_that_was_not_run_is_skipped_and_no_verdict_is_an_error(tmp_path: Path):
    write_junit(compared(lambda number, repeat: True, bound=5), tmp_path / "a.xml")
    assert Counter(elements(tmp_path / "a.xml").values()) == {"error": 1, "skipped": 8}


def test_what_a_policy_says_cannot_break_the_file(tmp_path: Path):
    class Rude(Planned):
        def answer(self, probe, repeat):
            return Outcome.error('\x00\x1b[31m <&"> \ufffe')

    write_junit(compare(probes(0, 1), Rude(lambda *_: True), Recorded("old")), tmp_path / "a.xml")
    error = Xml.parse(tmp_path / "a.xml").getroot().find("testsuite[@name='failing']//error")
    assert error.attrib["message"] == 'error; ??[31m <&"> ?'
