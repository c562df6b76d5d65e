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

    batches = 10

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


def test_the_next_triage_goes_on_where_the_last_one_was_interrupted(store, tmp_path):
    with Store.open(tmp_path / "whole.db", "write") as other:
        whole = PlantedRunner([TILTED, DARK])
        triage(fill(other, scenes([TILTED, DARK], 1)), lambda run: whole)
        (expected,) = other.triaged()
    before, after = interrupted(store), PlantedRunner([TILTED, DARK])
    triage(store, lambda run: after)
    (found,) = store.triaged()
    assert said(found) == said(expected)
    assert before.policy_rollouts >= 10
    assert before.policy_rollouts + after.policy_rollouts == whole.policy_rollouts == found.policy_rollouts


def test_several_interruptions_add_up(store):
    runners = [interrupted(store, batches) for batches in (3, 4, 5)]
    last = PlantedRunner([TILTED, DARK])
    triage(store, lambda run: last)
    (found,) = store.triaged()
    assert sum(each.policy_rollouts for each in (*runners, last)) == found.policy_rollouts


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
