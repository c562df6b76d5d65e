"""Several tasks and policies in one store: with real spaces and strategies, without a simulator."""

import shlex
import shutil
from pathlib import Path

import pytest

from tests.cli.typed import told, typed
from tests.doubles import ClosedForm, Raising
from vlafuzz.campaign import config
from vlafuzz.cli import main
from vlafuzz.report.sources import view_of_store
from vlafuzz.store.records import Manifest
from vlafuzz.store.store import Store
from vlafuzz.stored import StoredResults
from vlafuzz.worlds import task_of, tasks_named

pytestmark = pytest.mark.usefixtures("folder")
IDLE = ("--policy", "python:tests.doubles:make_idle", "--unchecked", "--no-certify", "--budget", "12")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two tasks of one policy, one of which another policy has tried, too."""
    store = tmp_path_factory.mktemp("mixed") / "mixed.db"
    other = ["--policy", "expert", "--strategy", "random", "--workers", "1"]
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(config, "make_evaluator", lambda manifest, _: ClosedForm(manifest.repeats))
        for flags in (["--task", "pick-up"], ["--task", "put-on"], ["--task", "pick-up", *other]):
            assert main(["run", *IDLE, *flags, "--store", str(store)]) == 0
    return store


@pytest.fixture
def mixed(made: Path, folder: Path) -> Path:
    return Path(shutil.copy(made, folder))


def test_a_store_of_several_tasks_and_policies_is_read_by_every_command(mixed: Path, capsys):
    for command in (
        ["report", str(mixed)],
        ["report", str(mixed), "--json"],
        ["report", str(mixed), "--no-videos", "--out", "page.html"],
        ["export", str(mixed), "--out", "failing.jsonl"],
    ):
        assert main(command) == 0, command
    assert "python:tests.doubles:make_idle on put-on · fails at:" in capsys.readouterr().out


def test_standings_tell_policies_and_tasks_apart(mixed: Path):
    rows = StoredResults(mixed).standings()
    assert [(row.task, row.rollouts) for row in rows] == [("pick-up", 12), ("put-on", 12), ("pick-up", 12)]
    idle, _, expert = rows
    with Store.open(mixed) as store:
        failed, judged = store.judged([3])
    assert expert.rate is not None
    assert expert.rate.value == failed / judged  # of all its random scenes
    assert (expert.causes, idle.certified) == (None, 0)


def test_the_page_of_two_tasks_compares_them(mixed: Path):
    with Store.open(mixed) as store:
        view = view_of_store(store)
    assert {card.of.scene.task for card in view.cards} == {"pick-up", "put-on"}
    assert view.tables[0].title == "Policies and tasks"
    assert len(view.tables[0].rows) == 3


def test_all_tasks_are_one_command_with_one_store_and_one_table(capsys):
    shown = told(capsys, ["run", *IDLE, "--task", "all", "--strategy", "random", "--json"])
    tasks = ["pick-up", "move-near", "put-on", "put-in"]
    assert [one["task"] for one in shown["tasks"]] == tasks
    assert [one["task"] for one in shown["standings"]] == tasks
    (store,) = Path("runs").glob("all-*.db")
    with Store.open(store) as opened:
        assert [run.manifest.task for run in opened.runs()] == tasks


def test_an_interrupted_list_of_tasks_goes_on_where_it_was(monkeypatch, capsys):
    wanted = [*IDLE, "--task", "pick-up,put-on,put-in", "--strategy", "random", "--store", "s.db"]

    def evaluator(manifest: Manifest, _: object) -> ClosedForm:
        end = Raising(KeyboardInterrupt(), after=3)
        return end if manifest.task == "put-on" else ClosedForm(manifest.repeats)

    with monkeypatch.context() as patched:
        patched.setattr(config, "make_evaluator", evaluator)
        patched.setattr("sys.argv", ["vlafuzz", "run", *wanted])
        assert shlex.join(["vlafuzz", "run", *wanted, "--resume"]) in typed(capsys, ["run", *wanted], code=130).err
    assert main(["run", *wanted, "--resume"]) == 0
    with Store.open(Path("s.db")) as store:
        runs = [(run.manifest.task, run.status, run.manifest.budget) for run in store.runs()]
    assert runs == [(task, "finished", 12) for task in ("pick-up", "put-on", "put-in")]


def test_a_wrong_task_of_a_list_is_named_before_anything_runs(capsys):
    assert main(["run", *IDLE, "--task", "pick-up,put-under", "--store", "s.db"]) == 2
    assert "unknown task 'put-under'" in capsys.readouterr().err
    assert not Path("s.db").exists()


@pytest.mark.libero
def test_a_suite_is_its_tasks():
    assert tasks_named("libero_goal, pick-up") == (*(f"libero_goal/{number}" for number in range(10)), "pick-up")
    assert task_of("libero", "libero_goal") == task_of("libero:libero_goal", None) == "libero_goal"
