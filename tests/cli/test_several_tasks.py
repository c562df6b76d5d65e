"""Several tasks and policies in one store: with real spaces and strategies, without a simulator."""

from pathlib import Path

import pytest

from tests.doubles import ClosedForm
from vlafuzz.campaign import launch
from vlafuzz.cli import main
from vlafuzz.report.sources import view_of_store
from vlafuzz.store.store import Store
from vlafuzz.stored import StoredResults

IDLE = ("--policy", "python:tests.doubles:make_idle", "--unchecked", "--no-certify", "--budget", "40")


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(launch, "make_evaluator", lambda manifest, _: ClosedForm(manifest.repeats))
    return tmp_path


@pytest.fixture
def mixed() -> Path:
    """Two tasks of one policy, one of which another policy has tried, too."""
    store = Path("mixed.db")
    assert main(["run", *IDLE, "--task", "pick-up", "--store", str(store)]) == 0
    assert main(["run", *IDLE, "--task", "put-on", "--store", str(store)]) == 0
    other = ["--policy", "expert", "--strategy", "random", "--workers", "1"]
    assert main(["run", *IDLE, "--task", "pick-up", *other, "--store", str(store)]) == 0
    return store


def test_a_store_of_several_tasks_and_policies_is_read_by_every_command(
    mixed: Path, capsys: pytest.CaptureFixture[str]
):
    for command in (
        ["findings", str(mixed)],
        ["findings", str(mixed), "--json"],
        ["report", str(mixed), "--no-videos", "--out", "page.html"],
        ["export", str(mixed), "--out", "failing.jsonl"],
        ["coverage", str(mixed)],
        ["merge", str(mixed), "--out", "merged.db"],
        ["report", "merged.db", "--no-videos", "--out", "merged.html"],
    ):
        assert main(command) == 0, command
    assert "python:tests.doubles:make_idle on put-on · loses" in capsys.readouterr().out


def test_standings_tell_policies_and_tasks_apart(mixed: Path):
    rows = StoredResults(mixed).standings()
    assert [(row.task, row.rollouts) for row in rows] == [("pick-up", 40), ("put-on", 40), ("pick-up", 40)]
    idle, _, expert = rows
    with Store.open(mixed) as store:
        failed, judged = store.judged([3])
    assert expert.rate is not None
    assert expert.rate.value == failed / judged  # of all its random scenes
    assert (expert.causes, idle.certified) == (None, 0)


def test_scenes_of_two_tasks_are_never_alike(mixed: Path):
    with Store.open(mixed) as store:
        task = {finding.scene.digest: finding.scene.task for finding in store.findings()}
        view = view_of_store(store)
    assert {card.scene.task for card in view.cards} == {"pick-up", "put-on"}
    assert all(task[digest] == card.scene.task for card in view.cards for digest in card.alike)
    assert view.causes[0].title == "Policies and tasks"
    assert len(view.causes[0].rows) == 3
