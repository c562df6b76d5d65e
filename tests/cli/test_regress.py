"""``vlafuzz regress`` on a corpus of thirty planted failures and forty controls."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from tests.cli.typed import complaint, typed
from tests.doubles import manifest
from tests.failures.corpus.corpora import case, make_corpus
from tests.failures.corpus.sides import RuleRunner
from vlafuzz.failures.corpus.folder import write_corpus
from vlafuzz.model import Outcome
from vlafuzz.rollouts import scene_runner as runner

RULES = {
    "idle": lambda shown: shown.light.intensity >= 0.5,  # as recorded
    "pinhole": lambda shown: shown.light.intensity >= 0.5 and shown.targets[0].x < -0.035,
    "expert": lambda shown: True,
}
MADE: list[RuleRunner] = []


@pytest.fixture(autouse=True)
def corpus(tmp_path: Path, monkeypatch) -> Path:
    """A corpus of a policy that fails in the dark; there is no simulator."""
    monkeypatch.chdir(tmp_path)
    MADE.clear()

    def make(source, run, policy):
        MADE.append(RuleRunner(RULES[policy], run))
        return MADE[-1]

    monkeypatch.setattr(runner, "SimulatorSceneRunner", make)
    monkeypatch.setattr("vlafuzz.rollouts.policies.built_in", lambda: dict.fromkeys(RULES, object))
    write_corpus(make_corpus(*map(case, range(30)), controls=40), tmp_path / "dark")
    return tmp_path / "dark"


def regress(capsys, words: str, *, code: int = 0):
    return typed(capsys, f"regress dark --policy {words}", code=code)


def test_the_corpus_own_policy_is_not_worse(capsys):
    printed = json.loads(regress(capsys, "idle --json").out)
    assert (printed["alarm"], printed["p_value"], printed["needed"]) == (False, 1, 5)
    assert printed["groups"]["control"]["policy"]["count"] == 32
    assert printed["difference"]["of_failure_rates"] == 0
    assert printed["groups"]["failing"]["standings"]["fails"] == 30
    assert [made.closed for made in MADE] == [1]


def test_a_worse_one_is_exit_code_1_and_what_it_breaks_is_shown_on_request(capsys):
    captured = regress(capsys, "pinhole", code=1)
    assert "pinhole is worse than idle as recorded: 9 worse and 0 better of 27 controls" in captured.out
    assert "biased upward, because the test stopped at the alarm" in captured.out
    assert "40 controls and 30 other scenes, at most 130 rollouts" in captured.err
    assert "32 of 40 controls pass: a loss of 35 points or more is noticed with 90% power" in captured.err
    whole = regress(capsys, "pinhole --whole", code=1).out
    assert "failure rate over controls: +50.0 points (+28.6 to +65.2)" in whole
    assert whole.count(" control ") == 20


def test_the_nights_share_alpha(capsys):
    printed = json.loads(regress(capsys, "pinhole --nights 30 --json", code=1).out)
    assert printed["alpha"] == pytest.approx(0.05 / 30)
    assert printed["groups"]["control"]["worse"] == 15


@pytest.mark.parametrize("words", ["regress rarely --policy pinhole", "bisect rarely --checkpoints idle pinhole"])
def test_where_no_alarm_is_possible_nothing_is_run(words: str, capsys):
    rarely = make_corpus(controls=40)
    controls = [replace(control, passed=number < 2) for number, control in enumerate(rarely.controls)]
    write_corpus(replace(rarely, controls=controls), Path("rarely"))
    said = typed(capsys, words.split(), code=3).err
    assert said.startswith("error: no alarm is possible: 2 of 40 controls pass, and it takes")
    assert "\nhint: export a corpus with more passing controls: run again in narrower ranges" in said
    assert MADE == []


def test_its_time_may_end_before_it_tells(capsys):
    assert "--time is over after 0 controls: cannot tell" in regress(capsys, "expert --time 0.000001s", code=3).out


def test_one_that_solves_the_failures_is_fine_and_said_to_fix_them_in_every_output(capsys):
    assert "failures are fixed: 30 of 30 failing scenes fixed" in regress(capsys, "expert").out
    printed = json.loads(regress(capsys, "expert --json").out)
    assert (printed["fixed"]["changed"], printed["fixed"]["of"], printed["fixed"]["shown"]) == (30, 30, True)


def test_models_at_one_address_are_told_apart_by_their_labels(tmp_path: Path, capsys):
    runs = [manifest(policy="idle", label="v1")]
    write_corpus(replace(make_corpus(case(), controls=40), runs=runs), tmp_path / "v1")
    command = "regress v1 --policy idle --label v2"
    assert "v2 (idle) is not shown to be worse than v1 (idle) as recorded" in typed(capsys, command).out
    refused = typed(capsys, f"{command} --baseline idle", code=2).err
    assert "error: --baseline idle cannot answer where v2 does" in refused


def test_against_another_baseline_both_roll_out_with_the_same_seeds(capsys):
    printed = json.loads(regress(capsys, "idle --baseline expert --json", code=1).out)
    assert printed["verdict"].startswith("idle is worse than expert: 8 worse and 0 better")
    assert MADE[0].calls == MADE[1].calls
    assert [made.closed for made in MADE] == [1, 1]


def test_a_corpus_without_controls_says_nothing_about_a_policy(tmp_path: Path, capsys):
    write_corpus(make_corpus(), tmp_path / "old")
    said = typed(capsys, "regress old --policy expert", code=2).err
    assert "error: old: has no controls, scenes that no outcome selected" in said


def test_other_conditions_than_the_corpus_are_said(monkeypatch, capsys):
    class Newer(RuleRunner):
        changed = ("spec", "simulator", "commit")
        renderer = "another"

    monkeypatch.setattr(runner, "SimulatorSceneRunner", lambda _, run, name: Newer(RULES[name], run))
    assert "than the corpus: its spec, simulator, renderer differ" in regress(capsys, "idle").err
    assert "than the corpus: its simulator, renderer differ" in regress(capsys, "expert").err


def test_a_policy_that_only_breaks_is_no_verdict_and_exit_code_3(monkeypatch, capsys):
    class Broken(RuleRunner):
        def evaluate(self, scenes, numbers):
            return [Outcome.error("policy: connect: no answer")] * len(scenes)

    monkeypatch.setattr(runner, "SimulatorSceneRunner", lambda _, run, name: Broken(RULES[name], run))
    printed = regress(capsys, "idle --json", code=3)
    why = "error: cannot tell: 0 of 10 controls could be judged; an alarm takes 9 or more: policy: connect"
    assert why in printed.err
    assert json.loads(printed.out)["stopped"] == "unjudged"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["none", "--policy", "idle"], "error: none/manifest.json: cannot be read"),
        (["dark", "--policy", "idel"], "error: unknown policy 'idel'"),
        (["dark", "--policy", "idle", "--baseline", "x"], "error: unknown policy 'x'"),
        (["dark", "--policy", "idle", "--alpha", "5"], "error: --alpha: expected a probability above 0"),
    ],
)
def test_what_is_wrong_is_said_before_anything_is_run(arguments, said, capsys):
    assert complaint(capsys, ["regress", *arguments]).startswith(said)
    assert MADE == []
