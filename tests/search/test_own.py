"""A user's own strategy, from its name to a finished run."""

from pathlib import Path

from tests.doubles import STAGES, manifest
from tests.search import climb
from tests.search.worlds import space, toy
from vlafuzz.campaign import fuzz
from vlafuzz.corpus.store import Corpus
from vlafuzz.execute.local import LocalExecutor
from vlafuzz.search.registry import strategy_factory


def test_a_strategy_of_ones_own_fuzzes(tmp_path: Path):
    strategy = strategy_factory("python:tests.search.climb:make")(space(), 0, 60)
    with Corpus.open(tmp_path / "own.db", "write") as corpus:
        summary = fuzz(
            manifest=manifest(strategy="python:tests.search.climb:make", budget=60),
            stages=STAGES,
            space=space(),
            strategy=strategy,
            executor=LocalExecutor(toy(share=0.1)),
            corpus=corpus,
        )
    assert (summary.rollouts, summary.proposals) == (60, 60)
    assert summary.findings > 10


def test_the_example_is_about_twenty_lines():
    lines = Path(climb.__file__).read_text().partition("import numpy")[2].splitlines()
    assert len([line for line in lines if line.strip()]) <= 22
