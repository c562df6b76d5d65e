"""How commands end: signals, a stdout that cannot be written, and user code that leaves or prints."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from tests.cli.typed import typed
from tests.doubles import ClosedForm, Idle
from vlafuzz.campaign import config
from vlafuzz.cli import main
from vlafuzz.model import Outcome, Scene
from vlafuzz.policies.harness import release

pytestmark = pytest.mark.usefixtures("folder")
FLAGS = ("--unchecked", "--no-certify", "--strategy", "random", "--budget", "12", "--store", "a.db")
HERE = "python:tests.cli.test_ending"


class Signalled(ClosedForm):
    """Gets a signal with the third scene."""

    def evaluate(self, scenes: Sequence[Scene]) -> list[Outcome]:
        if len(self.evaluated) == 2:
            signal.raise_signal(signal.SIGTERM)
        return super().evaluate(scenes)


def leave(*_: object) -> None:
    sys.exit(0)


class Unclosable(Idle):
    def close(self) -> None:
        raise RuntimeError("the device is gone")


class Exiting(Idle):
    def close(self) -> None:
        sys.exit(0)


def chatty() -> Idle:
    print("loading weights …")  # noqa: T201
    return Idle()


def test_sigterm_ends_a_run_in_order_and_names_what_is_stored_to_go_on(monkeypatch, capsys):
    monkeypatch.setattr(config, "make_evaluator", lambda *_: Signalled())
    before = signal.getsignal(signal.SIGTERM)
    assert main(["run", "--policy", "frozen", *FLAGS]) == 130
    assert "interrupted: all trials so far are stored in a.db\nhint: continue with" in capsys.readouterr().err
    assert signal.getsignal(signal.SIGTERM) is before
    monkeypatch.setattr(config, "make_evaluator", lambda *_: signal.raise_signal(signal.SIGTERM))
    said = typed(capsys, ["run", "--policy", "frozen", *FLAGS[:-1], "b.db"], code=130).err
    assert "interrupted: nothing is stored yet" in said
    assert "--resume" not in said


def started(code: str, *arguments: str) -> subprocess.Popen[str]:
    """The command as a process of its own, in which ``code`` runs first; Ctrl-C is not ignored."""
    source = f"import signal; signal.signal(signal.SIGINT, signal.default_int_handler); {code}"
    run = f"{source}\nimport sys; from vlafuzz.__main__ import main; sys.exit(main())"
    command = [sys.executable, "-c", run, *arguments]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


INTERRUPTED_IN = {
    "an import": "sys.meta_path.insert(0, Finder('typer'))",
    "the import of a command": "sys.meta_path.insert(0, Finder('vlafuzz.cli.lists'))",
    "code that is compiled": "sys.meta_path.insert(0, Finder('vlafuzz.cli.lists', 'exec(\"raised()\")'))",
}
FINDER = """
import sys
def raised():
    signal.raise_signal(signal.{signal})
class Finder:
    def __init__(self, name, code="raised()"):
        self.name, self.code = name, code
    def find_spec(self, name, *_):
        if name == self.name:
            exec(self.code, globals())
"""


@pytest.mark.parametrize(("where", "number"), [*zip(INTERRUPTED_IN, ["SIGTERM", "SIGINT", "SIGINT"], strict=True)])
def test_an_interruption_during_the_start_has_its_sentence_and_exit_code(where: str, number: str):
    code = FINDER.replace("{signal}", number) + INTERRUPTED_IN[where]
    with started(code, "list", "operators") as process:
        _, stderr = process.communicate()
    assert (process.returncode, stderr) == (130, "error: interrupted\n")


def test_an_interruption_that_is_swallowed_ends_the_command_all_the_same():
    swallowing = """
import time
from vlafuzz.cli import ending
from vlafuzz.cli import lists
ending.GRACE = 0.1
def swallow(*_):
    try:
        signal.raise_signal(signal.SIGINT)
    except BaseException:
        time.sleep(60)
lists.opened = swallow
"""
    with started(swallowing, "list", "operators") as process:
        _, stderr = process.communicate()
    assert (process.returncode, stderr) == (130, "\nended at once: finished trials are stored\n")


def test_an_interrupted_command_says_so(monkeypatch, capsys):
    monkeypatch.setattr("vlafuzz.cli.lists.opened", lambda *_: signal.raise_signal(signal.SIGINT))
    assert typed(capsys, ["list", "operators"], code=130).err == "error: interrupted\n"


def test_a_second_signal_ends_at_once():
    code = """
import signal
from vlafuzz.cli.ending import ending_in_order
with ending_in_order():
    try:
        signal.raise_signal(signal.SIGINT)
    except KeyboardInterrupt:  # takes its time to end in order
        signal.raise_signal(signal.SIGINT)
        print("goes on")
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout) == (130, "")
    assert "ended at once" in done.stderr


@pytest.mark.parametrize("command", [["list", "policies"], ["list", "policies", "--json"], ["run", "--help"]])
def test_a_reader_that_is_gone_is_neither_success_nor_findings(command: list[str]):
    read, write = os.pipe()
    os.close(read)
    words = [sys.executable, "-m", "vlafuzz", *command]
    done = subprocess.run(words, stdout=write, stderr=subprocess.PIPE, text=True, timeout=60)
    os.close(write)
    assert (done.returncode, done.stderr) == (141, "")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_a_full_stdout_is_one_sentence():
    words = [sys.executable, "-m", "vlafuzz", "list", "policies"]
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(words, stdout=full, stderr=subprocess.PIPE, text=True)
    assert done.returncode == 2
    assert done.stderr == "error: stdout: cannot be written: no space left on device\n"


def test_a_factory_that_leaves_the_process_is_an_error(capsys):
    assert main(["run", "--policy", f"{HERE}:leave", *FLAGS]) == 3
    assert f"error: {HERE}:leave: SystemExit: 0\nhint: raised at " in capsys.readouterr().err


def test_a_strategy_that_leaves_the_process_is_no_success(capsys):
    flags = ("--strategy", f"{HERE}:leave", "--policy", "frozen", "--store", "a.db")
    assert main(["run", *flags]) != 0
    assert "SystemExit" in capsys.readouterr().err


def test_no_exit_from_within_is_taken_for_success(monkeypatch, capsys):
    monkeypatch.setattr("vlafuzz.cli.lists.opened", leave)
    assert "ended the process: sys.exit(0)" in typed(capsys, ["list", "operators"], code=2).err


@pytest.mark.parametrize(("policy", "says"), [(Unclosable(), "RuntimeError"), (Exiting(), "SystemExit")])
def test_a_policy_that_cannot_be_closed_costs_no_result(policy: Idle, says: str, capsys):
    release(policy)
    assert capsys.readouterr().err.startswith(f"note: idle raised {says} in close: ")


def test_what_a_policy_prints_is_not_in_the_data(capsys):
    printed = typed(capsys, ["run", "--policy", f"{HERE}:chatty", *FLAGS, "--json"])
    assert json.loads(printed.out)["policy"] == f"{HERE}:chatty"
    assert "loading weights …" in printed.err
