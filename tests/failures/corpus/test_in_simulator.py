"""Two policies whose result is known, in the real simulator."""

from dataclasses import replace
from pathlib import Path

import pytest

from tests.doubles import manifest
from tests.failures.corpus.corpora import case, make_corpus
from vlafuzz.cli import main
from vlafuzz.common.assets import corpus_dir
from vlafuzz.failures.corpus.controls import draw
from vlafuzz.failures.corpus.corpus import Control
from vlafuzz.failures.corpus.folder import read_corpus, write_corpus
from vlafuzz.rollouts.policies import make_policy
from vlafuzz.worlds.provenance import here
from vlafuzz.worlds.tabletop.objects import load_catalogue
from vlafuzz.worlds.tabletop.space import SearchSpace, load_operators
from vlafuzz.worlds.tabletop.world import WORLD

PICK_UP = str(corpus_dir() / "mini-pick-up")


def corpus(folder: Path, *, passed: bool = False, **of_run: str) -> None:
    """A failure of ``frozen``, and what it is said to have done in controls."""
    run = manifest(policy="frozen", operators=load_operators().conditions["operators"], **of_run)
    space = SearchSpace(load_operators(), load_catalogue(), run.task)
    controls = [Control(draw(space, 0, number), passed) for number in range(8)]
    failing = replace(case(), counterparts={}, nominal_passes=False)
    write_corpus(replace(make_corpus(failing), runs=[run], controls=controls), folder)


def test_frozen_is_worse_than_the_expert_and_not_worse_than_itself(tmp_path: Path, capsys):
    corpus(tmp_path / "a")
    arguments = ["regress", str(tmp_path / "a"), "--policy"]
    assert main([*arguments, "frozen", "--baseline", "expert"]) == 1
    assert main([*arguments, "frozen"]) == 3  # none of its own controls passes, so none can break
    assert main([*arguments, "expert", "--baseline", "frozen"]) == 3
    assert "frozen is worse than expert: 8 worse and 0 better of 8 controls" in capsys.readouterr().out


def test_it_is_said_that_a_corpus_was_made_elsewhere(tmp_path: Path, capsys, monkeypatch):
    corpus(tmp_path / "a", passed=True, place=here("frozen", make_policy("frozen").spec, WORLD.renderer))
    for limit, said in (("", False), ("AVX2", True)):
        monkeypatch.setenv("ONEDNN_MAX_CPU_ISA", limit)
        assert main(["regress", str(tmp_path / "a"), "--policy", "frozen"]) == 1
        assert ("note: the corpus was made at another place: " in capsys.readouterr().err) is said


@pytest.mark.slow
@pytest.mark.render
def test_a_tenth_of_minis_weights_is_missed_and_none_is_not():
    assert main(["regress", PICK_UP, "--policy", "mini", "--baseline", "mini"]) == 0
    assert main(["regress", PICK_UP, "--policy", "mini"]) == 0
    assert main(["regress", PICK_UP, "--policy", "python:tests.failures.corpus.policies:zeroed"]) == 1


@pytest.mark.slow
def test_a_flaky_policy_is_hardly_ever_worse_than_itself(tmp_path: Path):
    whole = read_corpus(Path(PICK_UP))
    write_corpus(replace(whole, controls=whole.controls[:60]), tmp_path / "a")
    flaky = "python:tests.failures.corpus.policies:Flaky"
    arguments = ["regress", str(tmp_path / "a"), "--policy", flaky, "--baseline", flaky]
    assert sum(main(arguments) for _ in range(20)) <= 1
