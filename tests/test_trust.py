"""A store or corpus that somebody sent runs no code: ``python:`` names in it need ``--trust``."""

import random
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from tests.cli.typed import typed
from tests.doubles import begun, failed, manifest, trial
from tests.failures.corpus.corpora import case, make_corpus
from vlafuzz import api
from vlafuzz.cli import load, main, named
from vlafuzz.common.plugins import EVERYTHING, check_trusted, trusting
from vlafuzz.errors import UsageError
from vlafuzz.failures.corpus.folder import write_corpus
from vlafuzz.failures.triage.pipeline import runner_of_run
from vlafuzz.report.films import RunFilms
from vlafuzz.store.store import Store

RAN = "ran.txt"
MODULE = f"""
from pathlib import Path
Path({RAN!r}).write_text("import")
from tests.doubles import make_idle as make
"""
OWN = "python:sent_along:make"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch) -> Path:
    """A folder with a store, a corpus and the module that they name, as somebody may send it."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delitem(sys.modules, "sent_along", raising=False)
    Path("sent_along.py").write_text(MODULE)
    with Store.open(Path("a.db"), "write") as store:
        store.finish(begun(store, trial(0, failed()), about=manifest(policy=OWN)), "interrupted", 1.0)
    write_corpus(replace(make_corpus(case()), runs=[manifest(policy=OWN)]), Path("corpus"))
    return tmp_path


COMMANDS = {
    "replay": ["replay", "a.db"],
    "triage": ["triage", "a.db", "--workers", "1"],
    "resume": ["run", "--resume", "--store", "a.db"],
}


@pytest.mark.parametrize("name", COMMANDS)
def test_no_command_loads_code_because_a_file_names_it(name: str, folder: Path, capsys):
    said = typed(capsys, COMMANDS[name], code=2).err
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


def test_a_strategy_of_a_run_is_not_loaded_either(folder: Path, capsys):
    with Store.open(Path("b.db"), "write") as store:
        store.finish(store.begin(manifest(policy="frozen", strategy=OWN)), "interrupted", 1.0)
    assert f"the file names '{OWN}'" in typed(capsys, "run --resume --store b.db", code=2).err
    assert not (folder / RAN).exists()


CODE, SERVER = "code, which is not run", "a server elsewhere, which is not asked"


@pytest.mark.parametrize(
    ("names", "kind"),
    [
        ("random, python:a:b", CODE),
        ("python:a:b,random", CODE),
        ("lerobot:./sent?profile=libero", CODE),
        ("openpi:ws://gpu:8000", SERVER),
        ("http://127.0.0.1.example.org:1/act", SERVER),
        ("http://127.0.0.1,.example.org:1/act", SERVER),
        ("openpi:ws:\t//gpu:8000", SERVER),
        ("groot:tcp://[2001:db8::1]:5555?state_key=x,y", SERVER),
    ],
)
def test_no_name_that_loads_code_or_asks_a_server_elsewhere_is_overlooked(names: str, kind: str):
    with pytest.raises(UsageError, match=f"the file names .*: {kind}"):
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


POSITIONAL = {
    "bisect": ["corpus", "--checkpoints", "mini", "{}"],
    "diff": ["{}", "b.db"],
    "export": ["a.db", "{}", "--out", "b.db"],
    "report": ["{}"],
    "regress": ["{}", "--policy", "frozen"],
    "replay": ["{}"],
    "serve": ["{}"],
    "triage": ["{}"],
}


def test_no_positional_word_grants_trust():
    rng = random.Random(0)
    signs = (OWN, "--trust", "lerobot:x", "http://gpu:1/act", *", \n*?:a=/")
    commands = {name: load(name) for name in POSITIONAL}
    for _ in range(2000):
        word = "".join(rng.choices(signs, k=rng.randint(1, 6)))
        name = rng.choice(list(POSITIONAL))
        words = [part.replace("{}", word) for part in POSITIONAL[name]]
        if not word.startswith("-"):  # else it is a flag
            assert named(commands[name], words) == named(commands[name], POSITIONAL[name]), words


@pytest.mark.parametrize(
    ("words", "trusted"),
    [
        (["run", "--policy", OWN, "--strategy=python:a:b"], [OWN, "python:a:b"]),
        (["compare", "--strategies", "random, python:a:b"], ["random", "python:a:b"]),
        (["diff", "a.db", "b.db", "--policy-b", "a,python:x:y", "--trust"], ["a,python:x:y", EVERYTHING]),
        (["replay", "a.db", "--video", OWN], []),
        (["bisect", "corpus", "--checkpoints", OWN, OWN], []),
    ],
)
def test_the_values_of_flags_for_policies_and_strategies_do(words: list[str], trusted: list[str]):
    command, *others = words
    assert [name for name in named(load(command), others) if name != "{}"] == trusted


def test_the_name_of_a_store_is_no_trust(folder: Path):
    store = f"a,{OWN},.db"
    Path("a.db").rename(store)
    assert main(["replay", store]) == 2
    assert not (folder / RAN).exists()


def test_a_file_that_is_named_like_code_is_no_code(folder: Path, capsys):
    Path(OWN).touch()  # as `bisect corpus --checkpoints *` would name it
    assert "is the name of a file here" in typed(capsys, ["bisect", "corpus", "--checkpoints", "mini", OWN], code=2).err
    assert not (folder / RAN).exists()


@pytest.mark.parametrize("host", ["localhost", "127.0.0.1", "[::1]"])
def test_the_address_of_a_server_here_is_said_once(host: str, capsys):
    with trusting():
        check_trusted(f"openpi:ws://{host}:8000")
        check_trusted(f"openpi:ws://{host}:8000")
    assert capsys.readouterr().err == f"note: asks openpi:ws://{host}:8000, which the file names\n"
