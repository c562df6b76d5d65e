"""Triage that was interrupted: what a finding was rolled out for is not rolled out again."""

from collections.abc import Sequence
from pathlib import Path

import pytest

from tests.failures.triage.runners import PlantedRunner
from tests.failures.triage.triaging import DARK, TILTED, fill, scenes
from vlafuzz.failures.triage import pipeline
from vlafuzz.failures.triage.pipeline import triage
from vlafuzz.model.outcome import Outcome
from vlafuzz.model.scene import Scene
from vlafuzz.store.records import Triaged
from vlafuzz.store.store import Store


class Interrupted(PlantedRunner):
    """Ctrl-C after so many batches."""

    batches: int

    def evaluate(self, scenes: Sequence[Scene], numbers: Sequence[int]) -> list[Outcome]:
        self.batches -= 1
        if self.batches < 0:
            raise KeyboardInterrupt
        return super().evaluate(scenes, numbers)


def said(triaged: Triaged) -> dict[str, object]:
    return {name: value for name, value in vars(triaged).items() if name not in ("seconds", "witness")}


@pytest.fixture
def store(tmp_path: Path):
    with Store.open(tmp_path / "a.db", "write") as opened:
        yield fill(opened, scenes([TILTED, DARK], 1))


def interrupted(store: Store, batches: int = 10) -> Interrupted:
    runner = Interrupted([TILTED, DARK])
    runner.batches = batches
    with pytest.raises(KeyboardInterrupt):
        triage(store, lambda run: runner)
    assert store.triaged() == []
    return runner


@pytest.mark.parametrize("batches", [(10,), (3, 4, 5)])
def test_the_next_triage_goes_on_where_the_last_ones_were_interrupted(store, tmp_path, batches):
    with Store.open(tmp_path / "whole.db", "write") as other:
        whole = PlantedRunner([TILTED, DARK])
        triage(fill(other, scenes([TILTED, DARK], 1)), lambda run: whole)
        (expected,) = other.triaged()
    runners = [interrupted(store, number) for number in batches]
    assert min(runner.policy_rollouts for runner in runners) > 0
    triage(store, lambda run: runners.append(PlantedRunner([TILTED, DARK])) or runners[-1])
    (found,) = store.triaged()
    assert said(found) == said(expected)
    assert sum(runner.policy_rollouts for runner in runners) == whole.policy_rollouts == found.policy_rollouts


def test_another_machine_or_version_begins_anew(store, monkeypatch):
    interrupted(store)
    monkeypatch.setattr(pipeline, "commit", lambda: "another")
    runner = PlantedRunner([TILTED, DARK])
    triage(store, lambda run: runner)
    assert store.triaged()[0].policy_rollouts == runner.policy_rollouts


def test_nothing_is_kept_once_all_findings_are_done(store):
    made = f"{pipeline.platform.node()} {pipeline.commit()}"
    interrupted(store)
    assert store.repeats(1, made)
    triage(store, lambda run: PlantedRunner([TILTED, DARK]))
    assert store.repeats(1, made) == {}
