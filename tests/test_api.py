"""Fuzzing and triage from Python, with a policy that is an object."""

from collections.abc import Sequence
from pathlib import Path

import pytest

import vlafuzz
from tests.doubles import Idle
from tests.failures.corpus.corpora import make_corpus
from tests.failures.corpus.sides import RuleRunner
from tests.failures.triage.planted import DARK
from tests.failures.triage.runners import PlantedEvaluator, PlantedRunner
from tests.report.stores import store as stored_findings
from vlafuzz import api
from vlafuzz.api import fuzz, triage
from vlafuzz.campaign import config
from vlafuzz.errors import UsageError, VlafuzzError
from vlafuzz.failures.corpus.folder import write_corpus
from vlafuzz.policies.base import ActionChunk, Observation
from vlafuzz.store.store import Store
from vlafuzz.worlds.tabletop.experts.expert import Expert


class AfraidOfTheDark(Expert):
    """The expert, but it does not move where the light is low."""

    closed = 0

    def act(self, observations: list[Observation]) -> list[ActionChunk]:
        chunks = super().act(observations)
        dark = [observation.privileged.scene.light.intensity < 0.49 for observation in observations]
        return [ActionChunk(chunk.actions * 0) if d else chunk for chunk, d in zip(chunks, dark, strict=True)]

    def close(self) -> None:
        type(self).closed += 1


class Crashing(Idle):
    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        raise RuntimeError("no weights")


def test_a_policy_that_always_crashes_is_an_error_that_says_why(tmp_path: Path):
    with pytest.raises(VlafuzzError, match=r"all \d+ rollouts .* first: .*no weights") as caught:
        fuzz(Crashing(), strategy="random", budget=3, store=tmp_path / "a.db")
    assert "a.db" in str(caught.value.hint)


@pytest.mark.usefixtures("few_random_scenes")
def test_a_run_that_looks_for_causes_certifies_and_gives_them(tmp_path: Path, monkeypatch):
    monkeypatch.setattr(config, "make_evaluator", lambda *_: PlantedEvaluator([DARK]))
    monkeypatch.setattr(api, "SimulatorSceneRunner", lambda *_: PlantedRunner([DARK]))
    run = fuzz(Idle(), budget=60, strategy="causes", store=tmp_path / "a.db")
    store = vlafuzz.open_store(run.store)
    found = store.causes()
    assert "pick-up|grasp|light:dark" in {cause.signature for cause in found if cause.bucket == "minimal"}
    seen = []
    assert triage(run.store, Idle(), limit=1, watch=seen.append).signatures["pick-up|grasp|light:dark"] > 1
    assert (seen[0].done, seen[-1].done) == (0, 1)
    fuzz(Idle(), budget=60, strategy="causes", store=tmp_path / "a.db", certify=False, seed=1)
    assert {cause.bucket for cause in store.causes()} == {"observed"}  # of the last run
    assert store.causes(1) == found
    fuzz(Idle(), budget=2, strategy="random", store=tmp_path / "b.db")
    assert vlafuzz.open_store(tmp_path / "b.db").causes() == ()


def test_its_source_is_part_of_the_conditions(tmp_path: Path):
    run = fuzz(AfraidOfTheDark(), task="pick-up", budget=1, strategy="random", store=tmp_path / "a.db")
    with Store.open(tmp_path / "a.db") as store:
        (stored,) = store.runs()
    assert (run.policy, len(stored.manifest.source)) == ("object:expert", 12)


def test_a_store_of_an_object_needs_it_again(tmp_path: Path):
    fuzz(AfraidOfTheDark(), budget=4, vary=("light",), strategy="random", seed=2, store=tmp_path / "a.db")
    assert AfraidOfTheDark.closed == 0  # it is the user's
    with pytest.raises(UsageError, match="'object:expert' is an object that was handed over in Python"):
        triage(tmp_path / "a.db")


def test_it_works_in_this_process_only(tmp_path: Path):
    with pytest.raises(UsageError, match="works in this process only"):
        fuzz(AfraidOfTheDark(), budget=4, workers=2, store=tmp_path / "a.db")


def test_a_corpus_is_compared_and_checkpoints_are_searched(tmp_path: Path, monkeypatch):
    bright = {"old": 0.0, "new": 0.0, "newer": 9.0}  # light from which they pass
    monkeypatch.setattr("vlafuzz.rollouts.policies.built_in", lambda: dict.fromkeys(bright, object))
    monkeypatch.setattr(
        "vlafuzz.rollouts.scene_runner.SimulatorSceneRunner",
        lambda _, run, name: RuleRunner(lambda shown: shown.light.intensity >= max(bright[name], 0.5), run),
    )
    write_corpus(make_corpus(controls=40), tmp_path / "dark")
    assert not vlafuzz.regress(tmp_path / "dark", "new").alarm
    assert vlafuzz.regress(tmp_path / "dark", "newer", "old").alarm
    assert vlafuzz.bisect(tmp_path / "dark", ["old", "new", "newer"]).named == "newer"


def test_only_a_solved_finding_has_a_film_of_its_witness(tmp_path: Path):
    path = stored_findings(tmp_path / "a.db", findings=1, triaged=0)
    with pytest.raises(UsageError, match="has no witness"):
        vlafuzz.film(path, vlafuzz.open_store(path).findings()[0], witness=True)
