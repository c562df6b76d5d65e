"""Scenes of a run with ``--criteria published`` are judged by them wherever they are shown."""

from dataclasses import replace
from pathlib import Path

import gymnasium
import numpy as np
import pytest

from tests.doubles import manifest
from tests.failures.corpus.corpora import case, make_corpus
from tests.worlds.tabletop.sim.meddling import NOMINAL, evaluate, is_lifted, lets_go_at
from vlafuzz.exports.expert_runner import ExpertRunner
from vlafuzz.failures.corpus.folder import read_corpus, write_corpus
from vlafuzz.model.outcome import Verdict
from vlafuzz.policies.base import ActionSpec, PolicySpec
from vlafuzz.worlds.provenance import described


@pytest.fixture(scope="module", params=["published", "strict"])
def folder(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A corpus whose witness lets go too early for the strict criteria, of a run with these criteria."""
    (outcome,) = evaluate(lets_go_at(is_lifted, times=3), NOMINAL, criteria="published")
    assert outcome.verdict is Verdict.PASSED
    early = case()
    early = replace(early, scene=NOMINAL, witness=replace(early.witness, actions=outcome.rollouts[0].actions))
    corpus = replace(make_corpus(early), runs=[manifest(criteria=request.param)])
    path = tmp_path_factory.mktemp("corpora") / request.param
    write_corpus(corpus, path)
    return path


def test_a_corpus_environment_ends_with_the_success_of_its_run(folder: Path):
    env = gymnasium.make("vlafuzz.exports.gym:vlafuzz/Corpus-v0", corpus=folder, size=0)
    env.reset()
    ended = False
    for action in read_corpus(folder).cases[0].witness.actions.astype(np.float64):
        *_, ended, _, info = env.step(action)
        if ended:
            break
    env.close()
    assert ended == info["success"] == (folder.name == "published")


@pytest.mark.render
def test_actions_are_a_demonstration_where_they_succeed_by_the_criteria_of_the_run(folder: Path):
    corpus, spec = read_corpus(folder), PolicySpec("own", action=ActionSpec(relative_to="current"))
    runner = ExpertRunner(replace(corpus.runs[0], spec=described(spec)))
    shown = runner.record(corpus.cases[0].scene, corpus.cases[0].witness.actions)
    runner.close()
    assert (shown is not None) == (folder.name == "published")
