"""A user's own strategy, from its name to a finished run."""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from tests.doubles import manifest
from tests.search.worlds import space, toy
from vlafuzz.campaign.fuzz import Campaign
from vlafuzz.errors import PrerequisiteError, UsageError
from vlafuzz.rollouts.executor import LocalExecutor
from vlafuzz.search.base import Proposal, said_by
from vlafuzz.search.registry import Own, strategy_factory
from vlafuzz.store.store import Store


def test_a_strategy_of_ones_own_fuzzes(tmp_path: Path):
    name, executor = "python:tests.doubles:make_random_again", LocalExecutor(toy(share=0.1))
    parts = {"space": space(), "strategy": strategy_factory(name)(space(), 0, 60), "executor": executor}
    with Store.open(tmp_path / "own.db", "write") as store:
        summary = Campaign(manifest=manifest(strategy=name, budget=60), store=store, **parts).run()
    assert (summary.rollouts, summary.proposals) == (60, 60)
    assert summary.findings > 0


class Given:
    """Proposes the same genome for ever, with ids that are too high by so many."""

    about = "nothing new"

    def __init__(self, genome: Sequence[float], skipped: int = 0) -> None:
        self.genome, self.skipped = np.array(genome), skipped

    def ask(self, n: int) -> list[Proposal]:
        return [Proposal(number + self.skipped, self.genome) for number in range(n)]

    def tell(self, proposals: object, scores: object) -> None:
        pass


@pytest.mark.parametrize(
    ("strategy", "says"),
    [
        (Given([0.5, np.nan, 0.5]), "the genome of proposal 0 has nan, which is not in [0, 1]"),
        (Given([0.5, 0.5, 1.5]), "the genome of proposal 0 has 1.5, which is not in [0, 1]"),
        (Given([0.5]), "the genome of proposal 0 has the shape (1,), not (3,)"),
        (Given([0.5, 0.5, 0.5], 1), "proposal 0 has the id 1"),
    ],
)
def test_a_proposal_that_is_none_is_refused_in_a_sentence(strategy: Given, says: str):
    own = Own("python:mine:make", strategy, 3)
    with pytest.raises(UsageError) as caught:
        own.ask(2)
    assert str(caught.value) == f"strategy 'python:mine:make': {says}"
    assert caught.value.hint


def test_what_cannot_be_asked_is_no_strategy():
    with pytest.raises(UsageError, match="'python:mine:make' returned a int, which has no ask"):
        Own("python:mine:make", 3, 3)  # type: ignore[arg-type]


def breaks(space: object, seed: int, budget: int | None) -> object:
    raise KeyError("policy")


def breaks_within(*_: object) -> object:
    return json.loads("{")


class Breaking(Given):
    def ask(self, n: int) -> list[Proposal]:
        return [Proposal(0, self.genome[n:][0])]

    def tell(self, proposals: object, scores: object) -> None:
        raise ZeroDivisionError("no scores")


def test_what_it_raises_is_a_sentence_that_says_where():
    with pytest.raises(PrerequisiteError, match="breaks: KeyError: 'policy'") as caught:
        strategy_factory("python:tests.search.test_own:breaks")(space(), 0, 60)
    assert str(caught.value.hint).endswith(': raise KeyError("policy")')
    with pytest.raises(PrerequisiteError) as caught:
        strategy_factory("python:tests.search.test_own:breaks_within")(space(), 0, 60)
    assert str(caught.value.hint).endswith(': return json.loads("{")')  # not where in json
    own = Own("python:mine:make", Breaking([0.5, 0.5, 0.5]), 3)
    with pytest.raises(PrerequisiteError, match="python:mine:make: IndexError") as caught:
        own.ask(3)
    assert f"raised at {__file__}:" in str(caught.value.hint)
    with pytest.raises(PrerequisiteError, match="python:mine:make: ZeroDivisionError: no scores"):
        own.tell([], [])


def test_it_may_say_something_of_itself():
    assert said_by(Own("python:mine:make", Given([0.5]), 1), "about", "") == "nothing new"
    assert said_by(strategy_factory("python:tests.doubles:make_random_again")(space(), 0, 60), "about", "") == ""
