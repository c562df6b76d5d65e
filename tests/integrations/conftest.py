"""A corpus to integrate with."""

from dataclasses import replace
from pathlib import Path

import pytest

from tests.corpus.bundles import bundle, case
from tests.sim.scenes import nominal
from vlafuzz.corpus.folder import write_bundle
from vlafuzz.desk import SimulatorDesk
from vlafuzz.outcome import Verdict


@pytest.fixture(scope="session")
def corpus(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two scenes that the expert solves; the witness of the first is its solution."""
    from tests.test_desk import run

    desk = SimulatorDesk(Path("a.db"), run("make_frozen"))
    solved = desk.solve(nominal(), 0)
    desk.close()
    assert solved.verdict is Verdict.PASSED
    first = case()
    first = replace(
        first,
        scene=nominal(),
        witness=replace(first.witness, actions=solved.rollouts[0].actions),
    )
    folder = tmp_path_factory.mktemp("corpus") / "a"
    write_bundle(bundle(first, case(1)), folder)
    return folder
