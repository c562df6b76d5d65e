"""``vlafuzz bisect`` on a corpus of forty controls, each fifth of which is dark."""

import pytest

from tests.cli.typed import complaint, told, typed
from tests.failures.corpus.corpora import case, make_corpus
from tests.failures.corpus.sides import RuleRunner
from vlafuzz.failures.corpus.folder import write_corpus
from vlafuzz.rollouts import scene_runner as runner

OPENED: list[str] = []


@pytest.fixture(autouse=True)
def corpus(tmp_path, monkeypatch) -> None:
    """Checkpoints from 300 on do nothing any more."""
    monkeypatch.chdir(tmp_path)
    OPENED.clear()

    def make(source, run, policy):
        OPENED.append(policy)
        works = int(policy.removeprefix("mine-")) < 300
        return RuleRunner(lambda shown: shown.light.intensity >= 0.5 and works, run)

    names = [f"{prefix}{number}" for prefix in ("", "mine-") for number in range(100, 800, 100)]
    monkeypatch.setattr(runner, "SimulatorSceneRunner", make)
    monkeypatch.setattr("vlafuzz.rollouts.policies.built_in", lambda: dict.fromkeys(names, object))
    write_corpus(make_corpus(case(), controls=40), tmp_path / "dark")


def test_it_names_the_broken_checkpoint_and_exits_with_1(capsys):
    said = typed(capsys, "bisect dark --checkpoints 100 200 300 400 500 600 700", code=1)
    assert "the first broken checkpoint is 300 (" in said.out
    assert "7 checkpoints: at most 5 comparisons of at most 40 rollouts each" in said.err
    assert (OPENED[0], len(OPENED) <= 5) == ("700", True)


def test_a_pattern_names_the_policies(capsys):
    printed = told(capsys, "bisect dark --policy mine-{} --checkpoints 100 200 300 --json", code=1)
    assert (printed["corpus"], printed["named"], printed["certain"]) == ("dark", "mine-300", True)
    assert (printed["likely"], sum(printed["probabilities"].values())) == (["mine-300"], pytest.approx(1))
    assert printed["compared"][-1] | {"checkpoint": "mine-300", "passed": 0, "broken": 1.0} == printed["compared"][-1]
    assert printed["rollouts"] == sum(row["controls"] for row in printed["compared"])


def test_where_nothing_is_broken_it_exits_with_0(capsys):
    printed = told(capsys, "bisect dark --checkpoints 100 200 --json")
    assert (printed["alarm"], printed["named"], printed["likely"], OPENED) == (False, None, [], ["200"])
    assert printed["verdict"].startswith("200 is not shown to be worse than ")


def test_its_time_may_end_before_it_tells(capsys):
    said = typed(capsys, "bisect dark --checkpoints 100 200 --time 0.000001s", code=3).err
    assert "200: cannot tell: 0 of 0 controls could be judged" in said
    assert "give more --time" in said


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("", "expected different checkpoints, at least two, got none"),
        ("--checkpoints 100", "expected different checkpoints, at least two, got 100"),
        ("--checkpoints 100 100", "expected different checkpoints, at least two, got 100, 100"),
        ("--checkpoints 100 199", "unknown policy '199'"),
        ("--policy mine-100 --checkpoints 1 2", "--policy: 'mine-100' has no {}"),
        ("--checkpoints 100 200 --error 2", "--error: expected a probability"),
        ("--checkpoints 100 200 --comparisons 0", "--comparisons: expected at least 1"),
    ],
)
def test_what_is_wrong_is_said_before_anything_is_run(words, said, capsys):
    assert complaint(capsys, f"bisect dark {words}").startswith(f"error: {said}")
    assert OPENED == []
