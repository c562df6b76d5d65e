"""What the JUnit file says about a comparison."""

from collections import Counter
from pathlib import Path
from xml.etree import ElementTree as Xml

import pytest

from tests.regression.sides import Planned, probes
from vlafuzz.errors import UsageError
from vlafuzz.outcome import Outcome, Verdict
from vlafuzz.regression.junit import write_junit
from vlafuzz.regression.pairs import Answer
from vlafuzz.regression.regress import Recorded, compare


def compared(rule, bound: int | None = None):
    return compare(probes(4, 8), Planned(rule), Recorded("old"), max_rollouts=bound)


def elements(path: Path) -> dict[str, str]:
    """The element of each scene, by the name of the scene."""
    cases = Xml.parse(path).getroot().iter("testcase")
    return {
        case.attrib["name"].partition(": ")[2]: next((element.tag for element in case), "passed")
        for case in cases
    }


def test_a_scene_is_a_case_and_its_group_the_class(tmp_path: Path):
    write_junit(compared(lambda number, repeat: number >= 5), tmp_path / "a.xml")
    root = Xml.parse(tmp_path / "a.xml").getroot()
    assert [(suite.attrib["name"], suite.attrib["tests"]) for suite in root] == [
        ("failing", "4"),
        ("counterpart", "4"),
        ("nominal", "4"),
    ]
    assert {
        (suite.attrib["name"], case.attrib["classname"]) for suite in root for case in suite.iter("testcase")
    } == {(name, name) for name in ("failing", "counterpart", "nominal")}
    assert (root.attrib["tests"], root.attrib["failures"], root.attrib["skipped"]) == ("12", "1", "4")
    assert "not shown to be worse" in root.find(".//property[@name='verdict']").attrib["value"]


def test_a_broken_control_fails_and_what_the_baseline_fails_too_is_skipped(tmp_path: Path):
    def rule(number: int, repeat: int) -> Verdict | bool:
        return {0: True, 4: False, 5: Verdict.ERROR, 6: Verdict.INVALID}.get(number, number > 4)

    write_junit(compared(rule), tmp_path / "a.xml")
    assert elements(tmp_path / "a.xml") == {
        "failing 0": "passed",
        **{f"failing {number}": "skipped" for number in (1, 2, 3)},
        "nominal 4": "failure",
        "counterpart 5": "error",
        "nominal 6": "skipped",
        **{f"{'counterpart' if number % 2 else 'nominal'} {number}": "passed" for number in range(7, 12)},
    }
    assert "does not reach grasp" in (tmp_path / "a.xml").read_text()


def test_a_scene_that_was_not_run_is_skipped(tmp_path: Path):
    write_junit(compared(lambda number, repeat: True, bound=5), tmp_path / "a.xml")
    assert Counter(elements(tmp_path / "a.xml").values()) == {"passed": 5, "skipped": 7}


def test_what_a_policy_says_cannot_break_the_file(tmp_path: Path):
    class Rude(Planned):
        def answer(self, probe, repeat):
            return Answer.of(Outcome.error('\x00\x1b[31m <&"> \ufffe'))

    write_junit(compare(probes(1, 1), Rude(lambda *_: True), Recorded("old")), tmp_path / "a.xml")
    error = Xml.parse(tmp_path / "a.xml").getroot().find(".//error")
    assert error.attrib["message"] == 'error; ??[31m <&"> ?'


def test_a_file_that_cannot_be_written_is_a_sentence_and_leaves_nothing(tmp_path: Path):
    (tmp_path / "a.xml").mkdir()
    with pytest.raises(UsageError, match=r"a\.xml: cannot be written: is a directory"):
        write_junit(compared(lambda number, repeat: True), tmp_path / "a.xml")
    assert [path.name for path in tmp_path.iterdir()] == ["a.xml"]
