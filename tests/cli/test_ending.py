"""How commands end: signals, a reader that is gone, and user code that leaves or prints."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Sequence

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
