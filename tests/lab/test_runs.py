"""Which runs of a store a comparison takes, and how it does the others."""

import pytest

from tests.doubles import ClosedForm, manifest
from vlafuzz.campaign.config import Plan, RunConfig, plan
from vlafuzz.common.watch import SILENT, Watch
from vlafuzz.errors import UsageError
from vlafuzz.lab import compare
from vlafuzz.lab.compare import Job, complete, stored
from vlafuzz.rollouts.executor import LocalExecutor
from vlafuzz.store.records import Run
from vlafuzz.store.store import Store


class Told(Watch):
    """Keeps what it is told."""

    def __init__(self) -> None:
        self.bars: list[tuple[str, int, int | None]] = []

    def progress(self, description: str, done: int, total: int | None) -> None:
        self.bars.append((description, done, total))


@pytest.fixture
def executors(monkeypatch) -> list[Plan]:
    """The plans for which an executor was made; all of them evaluate in closed form."""
    plans: list[Plan] = []

    def make(planned: Plan) -> LocalExecutor:
        plans.append(planned)
        return LocalExecutor(ClosedForm())

    monkeypatch.setattr(compare, "make_executor", make)
    return plans


def planned(job: Job) -> Plan:
    return plan(RunConfig(policy="pinhole", strategy=job.strategy, budget=3, seed=job.seed))


def do(store: Store, *jobs: Job, watch: Watch = SILENT) -> list[Run]:
    return complete(store, jobs, planned, planned(jobs[0]).manifest, watch)


def test_adjacent_runs_that_differ_in_their_strategy_alone_share_an_executor(store: Store, executors: list[Plan]):
    do(store, Job("random", 1), Job("causes", 1), Job("random", 2))
    assert [run.manifest.seed for run in store.runs()] == [1, 1, 2]
    assert [planned.manifest.seed for planned in executors] == [1, 2]


@pytest.mark.usefixtures("executors")
def test_progress_counts_the_rollouts_of_all_runs(store: Store):
    told = Told()
    do(store, Job("random", 1), Job("random", 2), watch=told)
    assert told.bars[0] == ("run 1 of 2: random, seed 1", 0, 6)
    assert told.bars[-1] == ("run 2 of 2: random, seed 2", 6, 6)


@pytest.mark.parametrize(("statuses", "taken"), [("failed finished stopped", 2), ("failed running", 2)])
def test_of_equal_runs_the_first_finished_one_counts_else_the_newest(store: Store, statuses: str, taken: int):
    for status in statuses.split():
        store.finish(store.begin(manifest()), status, 1.0)  # type: ignore[arg-type]
    result = stored(store, manifest())
    assert result
    assert result.id == taken


@pytest.mark.parametrize(
    "change",
    [
        {"seed": 9}, {"budget": 9}, {"robot": "widowx"}, {"policy": "other"}, {"operators_digest": "x"},
        {"packs": '[{"name": "a", "digest": "b", "folder": "c"}]'}, {"strategy": "nsga2"},
    ],
)  # fmt: skip
def test_a_run_of_other_conditions_is_another_one(store: Store, change: dict[str, object]) -> None:
    store.begin(manifest())
    assert stored(store, manifest(**change)) is None  # type: ignore[arg-type]


def test_batches_may_differ(store: Store) -> None:
    store.begin(manifest(batch=3))
    assert stored(store, manifest(batch=16))


@pytest.mark.parametrize("name", ["commit", "place"])
def test_a_run_of_another_version_or_machine_is_refused(store: Store, name: str) -> None:
    store.begin(manifest())
    with pytest.raises(UsageError, match=f"another version, or elsewhere: its {name} differs") as caught:
        stored(store, manifest(**{name: "abc"}))  # type: ignore[arg-type]
    assert "another --store" in str(caught.value.hint)
