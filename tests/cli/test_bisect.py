"""``vlafuzz bisect`` on a corpus of forty controls, each fifth of which is dark."""

import json
from pathlib import Path

import pytest

from tests.failures.corpus.corpora import case, make_corpus
from tests.failures.corpus.sides import RuleRunner
from vlafuzz.cli import main
from vlafuzz.failures.corpus.folder import write_corpus
from vlafuzz.rollouts import scene_runner as runner

OPENED: list[str] = []


def passes(checkpoint: str):
    """Checkpoints from 300 on do nothing any more."""
    return lambda shown: shown.light.intensity >= 0.5 and int(checkpoint) < 300


@pytest.fixture(autouse=True)
def corpus(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    OPENED.clear()

    def make(source, run, policy):
        OPENED.append(policy)
        return RuleRunner(passes(policy.removeprefix("mine-")), run)

    names = [f"{prefix}{number}" for prefix in ("", "mine-") for number in range(100, 800, 100)]
    monkeypatch.setattr(runner, "SimulatorSceneRunner", make)
    monkeypatch.setattr("vlafuzz.rollouts.policies.built_in", lambda: dict.fromkeys(names, object))
    write_corpus(make_corpus(case(), controls=40), tmp_path / "dark")


def bisect(*arguments: str) -> int:
    return main(["bisect", "dark", *arguments])


def test_it_names_the_broken_checkpoint_and_exits_with_1(capsys):
    assert bisect("--checkpoints", "100", "200", "300", "400", "500", "600", "700") == 1
    captured = capsys.readouterr()
    assert "the first broken checkpoint is 300 (" in captured.out
    assert "7 checkpoints: at most 5 comparisons of at most 40 rollouts each" in captured.err
    assert OPENED[0] == "700"
    assert len(OPENED) <= 5


def test_its_time_may_end_before_it_tells(capsys):
    assert bisect("--checkpoints", "100", "200", "--time", "0.000001s") == 3
    assert "200: --time is over: cannot tell: 0 of 0 controls could be judged" in capsys.readouterr().err


def test_a_pattern_names_the_policies(capsys):
    assert bisect("--policy", "mine-{}", "--checkpoints", "100", "200", "300", "--json") == 1
    printed = json.loads(capsys.readouterr().out)
    assert (printed["named"], printed["certain"], printed["likely"]) == ("mine-300", True, ["mine-300"])
    assert sum(printed["probabilities"].values()) == pytest.approx(1)
    assert printed["comparisons"][0] | {"broken": 1.0} == printed["comparisons"][0]
    assert printed["rollouts"] == sum(step["of"] for step in printed["comparisons"])


def test_where_nothing_is_broken_it_exits_with_0(capsys):
    assert bisect("--checkpoints", "100", "200", "--json") == 0
    printed = json.loads(capsys.readouterr().out)
    assert (printed["alarm"], printed["named"], printed["likely"], OPENED) == (False, None, [], ["200"])


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([], "error: expected different checkpoints, at least two, got none"),
        (["--checkpoints", "100"], "error: expected different checkpoints, at least two, got 100"),
        (["--checkpoints", "100", "199"], "error: unknown policy '199'"),
        (["--policy", "mine-100", "--checkpoints", "1", "2"], "error: --policy: 'mine-100' has no {}"),
        (["--checkpoints", "100", "200", "--error", "2"], "error: --error: expected a probability"),
        (["--checkpoints", "100", "200", "--comparisons", "0"], "error: --comparisons: expected at least 1"),
    ],
)
def test_what_is_wrong_is_said_before_anything_is_run(arguments, said, capsys):
    assert bisect(*arguments) == 2
    assert capsys.readouterr().err.startswith(said)
    assert OPENED == []
