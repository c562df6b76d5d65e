"""A store or corpus that somebody sent runs no code: ``python:`` names in it need ``--trust``."""

import sys
from dataclasses import replace
from pathlib import Path

import pytest

from tests.doubles import failed, manifest, trial
from tests.regression.corpora import case, make_corpus
from vlafuzz import api
from vlafuzz.cli import main
from vlafuzz.errors import UsageError
from vlafuzz.plugins import EVERYTHING, check_trusted, trusting
from vlafuzz.regression.folder import write_corpus
from vlafuzz.report.films import RunFilms
from vlafuzz.store.store import Store
from vlafuzz.triage.scene_runner import runner_of_run

RAN = "ran.txt"
MODULE = f"""
from pathlib import Path
Path({RAN!r}).write_text("import")
from tests.doubles import make_idle as make
"""
OWN = "python:sent_along:make"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a store, a corpus and the module that they name, as somebody may send it."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delitem(sys.modules, "sent_along", raising=False)
    Path("sent_along.py").write_text(MODULE)
    with Store.open(Path("a.db"), "write") as store:
        run = store.begin(manifest(policy=OWN))
        store.add(run, trial(0, failed()))
        store.finish(run, "interrupted", 1.0)
    without_controls = replace(make_corpus(case()), runs=[manifest(policy=OWN)], controls=())
    write_corpus(without_controls, Path("corpus"))
    return tmp_path


COMMANDS = {
    "replay": ["replay", "a.db"],
    "triage": ["triage", "a.db", "--workers", "1"],
    "resume": ["run", "--resume", "--store", "a.db"],
    "regress": ["regress", "corpus", "--policy", "frozen"],
}


@pytest.mark.parametrize("name", COMMANDS)
def test_no_command_loads_code_because_a_file_names_it(
    name: str, folder: Path, capsys: pytest.CaptureFixture[str]
):
    assert main(COMMANDS[name]) == 2
    said = capsys.readouterr().err
    assert f"error: the file names '{OWN}': code" in said
    assert "--trust" in said
    assert not (folder / RAN).exists()


@pytest.mark.parametrize("named", [["--trust"], ["--policy", OWN], [f"--policy={OWN}"]])
def test_code_is_loaded_when_the_user_names_it_or_trusts_the_file(named: list[str], folder: Path):
    main(["replay", "a.db", *named])
    assert (folder / RAN).exists()


def test_films_and_scene_runners_load_no_such_code(folder: Path):
    with Store.open(Path("a.db")) as store:
        (run,) = store.runs()
    with pytest.raises(UsageError, match="the file names"):
        RunFilms(Path("a.db"))(run.manifest, trial(0, failed()).scene, None)
    with pytest.raises(UsageError, match="the file names"):
        runner_of_run(Path("a.db"), run)
    with pytest.raises(UsageError, match="the file names"):
        api.triage("a.db")
    assert not (folder / RAN).exists()


def test_a_strategy_of_a_run_is_not_loaded_either(folder: Path, capsys: pytest.CaptureFixture[str]):
    with Store.open(Path("b.db"), "write") as store:
        store.finish(store.begin(manifest(policy="frozen", strategy=OWN)), "interrupted", 1.0)
    assert main(["run", "--resume", "--store", "b.db"]) == 2
    assert f"the file names '{OWN}'" in capsys.readouterr().err
    assert not (folder / RAN).exists()


@pytest.mark.parametrize(
    "names", ["random, python:a:b", "python:a:b,random", "lerobot:./sent?profile=libero"]
)
def test_no_name_that_loads_code_is_overlooked(names: str):
    with pytest.raises(UsageError, match="the file names"):
        check_trusted(names)
    with trusting(names):
        check_trusted(names)


def test_trust_ends_with_the_command():
    with trusting("python:a:b"):
        check_trusted("mini", "python:a:b")
        with trusting(EVERYTHING):
            check_trusted("python:c:d")
        with pytest.raises(UsageError, match="python:c:d"):
            check_trusted("python:c:d")
    with pytest.raises(UsageError, match="python:a:b"):
        check_trusted("python:a:b")


def test_the_words_of_another_file_name_are_no_trust(folder: Path):
    main(["replay", "a.db", "--trace", f"my-{OWN}"])
    assert not (folder / RAN).exists()
