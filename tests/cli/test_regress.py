"""``vlafuzz regress`` on a corpus of thirty planted failures."""

import json
from pathlib import Path
from xml.etree import ElementTree as Xml

import pytest

from tests.regression.corpora import case, make_corpus
from tests.regression.sides import RuleRunner
from vlafuzz.cli import main
from vlafuzz.outcome import Outcome
from vlafuzz.regression.folder import write_corpus
from vlafuzz.triage import scene_runner as runner

RULES = {
    "idle": lambda shown: shown.light.intensity >= 0.5,  # as recorded
    "pinhole": lambda shown: shown.light.intensity >= 0.5 and shown.targets[0].x < -0.03,
    "expert": lambda shown: True,
}
MADE: list[RuleRunner] = []


@pytest.fixture(autouse=True)
def corpus(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A corpus of a policy that fails in the dark; there is no simulator."""
    monkeypatch.chdir(tmp_path)
    MADE.clear()

    def make(source, run, policy):
        MADE.append(RuleRunner(RULES[policy], run))
        return MADE[-1]

    monkeypatch.setattr(runner, "SimulatorSceneRunner", make)
    monkeypatch.setattr("vlafuzz.policies.registry.POLICIES", dict.fromkeys(RULES))
    write_corpus(make_corpus(*map(case, range(30))), tmp_path / "dark")
    return tmp_path / "dark"


def regress(*arguments: str) -> int:
    return main(["regress", "dark", "--policy", *arguments])


def test_the_corpus_own_policy_is_not_worse(capsys: pytest.CaptureFixture[str]):
    assert regress("idle", "--json") == 0
    printed = json.loads(capsys.readouterr().out)
    assert (printed["alarm"], printed["p_value"], printed["needed"]) == (False, 1, 5)
    assert printed["groups"]["failing"]["standings"]["fails"] == 30
    assert printed["groups"]["counterpart"]["standings"]["passes"] == 29
    assert printed["groups"]["nominal"]["policy"]["count"] == 1
    assert [made.closed for made in MADE] == [1]


def test_a_worse_one_is_exit_code_1_and_says_which_scenes(capsys: pytest.CaptureFixture[str]):
    assert regress("pinhole") == 1
    captured = capsys.readouterr()
    assert "pinhole is worse than idle as recorded: 5 worse and 0 better" in captured.out
    assert captured.out.count(" without light") == 5
    assert "60 scenes, at most 60 rollouts, about 13 s at the corpus's own speed" in captured.err


def test_one_that_solves_the_failures_is_fine(capsys: pytest.CaptureFixture[str]):
    assert regress("expert") == 0
    assert "solved: only the policy passes" in capsys.readouterr().out


def test_against_another_baseline_both_roll_out_with_the_same_seeds(capsys: pytest.CaptureFixture[str]):
    assert regress("idle", "--baseline", "expert", "--json") == 1
    printed = json.loads(capsys.readouterr().out)
    assert printed["verdict"].startswith("idle is worse than expert: 7 worse and 0 better")
    assert MADE[0].calls == MADE[1].calls
    assert [made.closed for made in MADE] == [1, 1]


def test_a_stochastic_policy_gets_the_corpus_own_as_its_baseline(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    def make(source, run, policy):
        MADE.append(RuleRunner(RULES[policy], run, deterministic=False))
        return MADE[-1]

    monkeypatch.setattr(runner, "SimulatorSceneRunner", make)
    assert regress("idle", "--max-rollouts", "80") == 0
    captured = capsys.readouterr()
    assert "note: a stochastic policy cannot be compared fairly with recorded outcomes" in captured.err
    assert "idle is rolled out, too" in captured.err
    assert "at most 160 rollouts" in captured.err
    assert len(MADE) == 2


def test_other_conditions_than_the_corpus_are_said(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    class Newer(RuleRunner):
        changed = ("spec", "simulator", "commit")
        renderer = "another"

    monkeypatch.setattr(runner, "SimulatorSceneRunner", lambda _, run, name: Newer(RULES[name], run))
    regress("idle")
    assert "than the corpus: its spec, simulator, renderer differ" in capsys.readouterr().err
    regress("expert")
    assert "than the corpus: its simulator, renderer differ" in capsys.readouterr().err


def test_junit_is_written(capsys: pytest.CaptureFixture[str]):
    assert regress("pinhole", "--junit", "a.xml") == 1
    assert Xml.parse("a.xml").getroot().attrib["failures"] == "5"
    assert "written: a.xml" in capsys.readouterr().err


def test_a_policy_that_only_breaks_is_no_verdict_and_exit_code_3(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    class Broken(RuleRunner):
        def evaluate(self, scenes, numbers):
            return [Outcome.error("policy: connect: no answer")] * len(scenes)

    monkeypatch.setattr(runner, "SimulatorSceneRunner", lambda _, run, name: Broken(RULES[name], run))
    assert regress("idle", "--json") == 3
    captured = capsys.readouterr()
    assert (
        "error: cannot tell: only 0 of 10 rollouts could be judged: policy: connect: no answer"
        in captured.err
    )
    assert json.loads(captured.out)["stopped"] == "unjudged"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["none", "--policy", "idle"], "error: none/manifest.json: cannot be read"),
        (["dark", "--policy", "idel"], "error: unknown policy 'idel'"),
        (["dark", "--policy", "idle", "--baseline", "x"], "error: unknown policy 'x'"),
        (["dark", "--policy", "idle", "--alpha", "5"], "error: --alpha: expected a probability above 0"),
        (
            ["dark", "--policy", "idle", "--max-rollouts", "0"],
            "error: --max-rollouts: expected at least 1",
        ),
        (
            ["dark", "--policy", "idle", "--junit", "no/a.xml"],
            "error: --junit: no/a.xml: no place",
        ),
    ],
)
def test_what_is_wrong_is_said_before_anything_is_run(arguments, said, capsys: pytest.CaptureFixture[str]):
    assert main(["regress", *arguments]) == 2
    error = capsys.readouterr().err
    assert error.startswith(said)
    assert "\nhint: " in error
    assert MADE == []
