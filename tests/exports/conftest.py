"""A corpus for the integrations."""

from dataclasses import replace
from pathlib import Path

import pytest

from tests.failures.corpus.corpora import case, make_corpus
from tests.worlds.tabletop.sim.scenes import nominal
from vlafuzz.common.plugins import EVERYTHING, trusting
from vlafuzz.failures.corpus.folder import write_corpus
from vlafuzz.model import Verdict
from vlafuzz.rollouts.scene_runner import SimulatorSceneRunner


@pytest.fixture(scope="session")
def corpus(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two scenes that the expert solves; the witness of the first is its solution."""
    from tests.rollouts.test_scene_runner import run

    with trusting(EVERYTHING):
        runner = SimulatorSceneRunner(Path("a.db"), run("make_frozen"))
        solved = runner.solve(nominal(), 0)
        runner.close()
    assert solved.verdict is Verdict.PASSED
    solution = replace(case().witness, actions=solved.rollouts[0].actions)
    first = replace(case(), scene=nominal(), witness=solution)
    folder = tmp_path_factory.mktemp("corpus") / "a"
    write_corpus(make_corpus(first, case(1)), folder)
    return folder
