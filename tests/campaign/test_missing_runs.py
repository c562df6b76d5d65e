import json
from functools import partial
from pathlib import Path

import pytest

from tests.doubles import Always, ClosedForm, manifest
from vlafuzz.campaign import launch
from vlafuzz.campaign.config import Plan, RunConfig, plan
from vlafuzz.campaign.launch import WantedRun, do_missing, note_places, stored_run
from vlafuzz.common.watch import SILENT, Watch
from vlafuzz.errors import UsageError, VlafuzzError
from vlafuzz.model.outcome import Outcome
from vlafuzz.rollouts.executor import LocalExecutor
from vlafuzz.store.records import Run
from vlafuzz.store.store import Store


class Told(Watch):
    """Keeps what it is told."""

    def __init__(self) -> None:
        self.bars: list[tuple[str, int, int | None]] = []
        self.notes: list[str] = []

    def progress(self, description: str, done: int, total: int | None) -> None:
        self.bars.append((description, done, total))

    def note(self, text: str) -> None:
        self.notes.append(text)


@pytest.fixture
def executors(monkeypatch) -> list[Plan]:
    """The plans for which an executor was made; all of them evaluate in closed form."""
    plans: list[Plan] = []

    def make(planned: Plan) -> LocalExecutor:
        plans.append(planned)
        return LocalExecutor(ClosedForm())

    monkeypatch.setattr(launch, "make_executor", make)
    return plans


@pytest.fixture
def store(tmp_path: Path):
    with Store.open(tmp_path / "a.db", "write") as opened:
        yield opened


def wanted(seed: int, stored: Run | None = None, group: object = None) -> WantedRun:
    config = RunConfig(policy="pinhole", strategy="random", budget=3, seed=seed)
    return WantedRun(name=f"seed {seed}", budget=3, plan=partial(plan, config), stored=stored, group=group)


def test_adjacent_runs_of_one_group_share_an_executor(store: Store, executors: list[Plan]):
    do_missing(store, [wanted(1, group="a"), wanted(2, group="a"), wanted(3, group="b")], SILENT)
    assert [run.manifest.seed for run in store.runs()] == [1, 2, 3]
    assert [planned.manifest.seed for planned in executors] == [1, 3]


def test_finished_runs_are_left_alone(store: Store, executors: list[Plan]):
    do_missing(store, [wanted(1)], SILENT)
    do_missing(store, [wanted(1, store.runs()[0]), wanted(2)], SILENT)
    assert [run.manifest.seed for run in store.runs()] == [1, 2]


@pytest.mark.usefixtures("executors")
def test_an_interrupted_run_is_resumed(store: Store):
    run = store.begin(wanted(1).plan().manifest)
    do_missing(store, [wanted(1, store.runs()[0])], SILENT)
    assert [(kept.id, kept.status, store.count(kept.id)) for kept in store.runs()] == [(run, "finished", 3)]


@pytest.mark.usefixtures("executors")
def test_a_run_that_was_interrupted_elsewhere_begins_anew(store: Store, monkeypatch):
    store.begin(wanted(1).plan().manifest)
    told = Told()
    monkeypatch.setenv("ONEDNN_MAX_CPU_ISA", "AVX2")
    do_missing(store, [wanted(1, store.runs()[0])], told)
    assert [(run.id, run.status, store.count(run.id)) for run in store.runs()] == [
        (1, "running", 0),
        (2, "finished", 3),
    ]
    assert told.notes[0].startswith("seed 1: begins anew, since run 1 ended early at another place: ")


def test_runs_of_several_places_are_noted_as_such(store: Store):
    told = Told()
    places = ("", "", json.dumps({"processor": "arm64", "instructions": "DEFAULT", "torch": "2.13"}))
    for place in places:
        store.begin(manifest(place=place))
    note_places(store.runs()[:2], told)
    note_places(store.runs(), told)
    (note,) = told.notes
    assert "(run 1, 2: not known; run 3: arm64, DEFAULT, torch 2.13)" in note


@pytest.mark.usefixtures("executors")
def test_progress_counts_the_rollouts_of_all_runs(store: Store):
    told = Told()
    do_missing(store, [wanted(1), wanted(2)], told)
    assert told.bars[0] == ("run 1 of 2: seed 1", 0, 6)
    assert told.bars[-1] == ("run 2 of 2: seed 2", 6, 6)


def test_a_run_that_judges_no_scene_is_an_error(store: Store, monkeypatch):
    broken = Always(Outcome.error("no light"))
    monkeypatch.setattr(launch, "make_executor", lambda planned: LocalExecutor(broken))
    with pytest.raises(VlafuzzError, match=r"no scene could be judged: .*no light"):
        do_missing(store, [wanted(1)], SILENT)


@pytest.mark.usefixtures("executors")
def test_a_run_that_cannot_be_done_is_left_out_where_that_is_allowed(store: Store):
    left: list[str] = []

    def fails() -> Plan:
        raise UsageError("no room")

    impossible = WantedRun(name="impossible", budget=3, plan=fails, stored=None, group=1)
    do_missing(store, [impossible, wanted(2)], SILENT, lambda run, error: left.append(f"{run.name}: {error}"))
    assert left == ["impossible: no room"]
    assert len(store.runs()) == 1


def test_of_equal_runs_the_first_finished_one_counts_else_the_newest():
    def run(number: int, status: str) -> Run:
        return Run(id=number, manifest=wanted(1).plan().manifest, status=status, started="")  # type: ignore[arg-type]

    assert stored_run([run(1, "failed"), run(2, "finished"), run(3, "stopped")]).id == 2  # type: ignore[union-attr]
    assert stored_run([run(1, "failed"), run(2, "running")]).id == 2  # type: ignore[union-attr]
    assert stored_run([]) is None
