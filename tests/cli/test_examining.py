"""``vlafuzz doctor --policy``, and what ``vlafuzz run`` looks at first."""

import json
import re
import socket
import time
from itertools import count
from pathlib import Path

import numpy as np
import pytest

from tests.cli.typed import told, typed
from tests.doctor.faults import FAULTS, Changed
from vlafuzz.cli import main
from vlafuzz.policies.base import Policy
from vlafuzz.report.sources import view_of_store
from vlafuzz.store.store import Store

HERE = "python:tests.cli.test_examining"


def deaf() -> Policy:
    return FAULTS["deaf"]("pinhole")


def constant() -> Policy:
    return FAULTS["constant"]("pinhole")


def idle() -> Policy:
    """Fails in every scene, as it hardly moves."""
    return FAULTS["wrong scale"]("pinhole")


def drowsy() -> Policy:
    """Takes 40 ms for an answer."""

    def answer(actions: np.ndarray) -> np.ndarray:
        time.sleep(0.04)
        return actions

    return Changed("pinhole", answer=answer)


def interrupted() -> Policy:
    """Ctrl-C comes at its 31st answer, when it is asked again."""
    answers = count()

    def answer(actions: np.ndarray) -> np.ndarray:
        if next(answers) == 30:
            raise KeyboardInterrupt
        return actions

    return Changed("pinhole", answer=answer)


def broken() -> Policy:
    raise FileNotFoundError("weights.pt")


def rows(capsys, policy: str, *, code: int) -> dict[str, dict[str, str]]:
    return {row["check"]: row for row in told(capsys, f"doctor --policy {policy} --n 1 --json", code=code)}


def test_the_doctor_finds_nothing_wrong_with_a_healthy_policy(capsys):
    checks = rows(capsys, "pinhole", code=0)
    assert {row["verdict"] for row in checks.values()} == {"ok"}
    assert list(checks)[-3:] == ["rollouts", "nominal", "wiring"]


def test_a_server_that_is_not_there_is_refused_with_what_to_start(capsys):
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        port = listening.getsockname()[1]
    (row,) = rows(capsys, f"vla-eval:ws://127.0.0.1:{port}", code=3).values()
    assert (row["check"], row["verdict"]) == ("connects", "refuse")
    assert row["follows"].startswith("start it first")


def test_code_of_the_users_that_raises_is_refused_with_what_it_raised(capsys):
    checks = rows(capsys, f"{HERE}:broken", code=3)["connects"]
    assert checks["found"] == f"{HERE}:broken: FileNotFoundError: weights.pt"
    assert checks["follows"].startswith(f"raised at {__file__}:")
    assert checks["follows"].endswith(': raise FileNotFoundError("weights.pt")')


def test_code_whose_import_raises_is_refused_in_a_sentence(tmp_path: Path, monkeypatch, capsys):
    (tmp_path / "lacks_a_package.py").write_text("import unheard_of\n")
    monkeypatch.syspath_prepend(tmp_path)
    assert run(tmp_path, "python:lacks_a_package:make") == 3
    assert "ModuleNotFoundError: No module named 'unheard_of'\nhint: raised at " in capsys.readouterr().err


def test_a_protocol_without_an_address_is_refused_with_its_form(capsys):
    assert "hint: expected openpi:ws://host:port?option=value" in typed(capsys, "doctor --policy openpi", code=2).err


def test_ctrl_c_leaves_what_was_found_by_then(capsys):
    assert list(rows(capsys, f"{HERE}:interrupted", code=130)) == ["spec", "connects", "actions"]


@pytest.mark.parametrize(
    ("flags", "says"),
    [
        (["--task", "put-on"], "--task needs --policy"),
        (["--world", "python:tests.worlds.carts:Carts", "--n", "2", "--json"], "--n needs --policy"),
        (["--policy", "pinhol"], "unknown policy 'pinhol'"),
        (["--policy", "pinhole", "--n", "0"], "--n: expected at least 1, got 0"),
        (["--policy", "pinhole", "--task", "put_on"], "unknown task 'put_on'"),
    ],
)
def test_a_wrong_flag_of_the_doctor_is_a_sentence(capsys, flags: list[str], says: str):
    assert says in typed(capsys, ["doctor", *flags], code=2).err


def run(folder: Path, name: str, *flags: str) -> int:
    store = ("--store", str(folder / "a.db"))
    return main(["run", "--policy", name, "--strategy", "random", "--budget", "1", *store, "--json", *flags])


def test_a_run_of_a_policy_that_cannot_be_tested_does_not_begin(tmp_path: Path, capsys):
    assert run(tmp_path, f"{HERE}:constant") == 3
    message, hint = capsys.readouterr().err.splitlines()
    assert message.startswith(f"error: {HERE}:constant is not run: 24 times the same: 0.01, 0.01, 0.01")
    assert hint.startswith("hint: constant: its actions do not depend on the scene")
    assert hint.endswith("--unchecked runs it all the same")
    assert not (tmp_path / "a.db").exists()


@pytest.mark.parametrize(
    ("name", "flags", "checkup"), [(f"{HERE}:constant", ["--unchecked"], "unchecked"), ("frozen", [], "")]
)
def test_a_run_that_was_not_to_look_says_so_and_our_own_policies_are_not_asked(tmp_path, capsys, name, flags, checkup):
    assert run(tmp_path, name, *flags) == 0
    assert json.loads(capsys.readouterr().out)["checkup"] == checkup


def test_a_run_is_labelled_with_what_is_wrong_with_its_policy(tmp_path: Path, capsys):
    assert run(tmp_path, f"{HERE}:deaf") == 0
    shown = capsys.readouterr()
    label = json.loads(shown.out)["checkup"]
    assert label.startswith("deaf: it ignores its instruction")
    assert label in shown.err
    with Store.open(tmp_path / "a.db") as store:
        assert store.runs()[0].manifest.checkup == label
        (runs,) = (table for table in view_of_store(store).tables if table.title == "Runs")
        assert runs.rows[0]["checkup"] == label


@pytest.mark.slow
def test_a_run_says_before_it_starts_how_long_it_will_take(tmp_path: Path, capsys):
    flags = ["--policy", f"{HERE}:drowsy", "--budget", "20", "--store", str(tmp_path / "a.db"), "--json"]
    printed = typed(capsys, ["run", *flags, "--strategy", "random"])
    said = re.search(r"20 rollouts of up to 80 steps take (\d+) (s|min) to (\d+) (s|min); measured", printed.err)
    assert said is not None
    low, high = (int(said[group]) * {"s": 1, "min": 60}[said[group + 1]] for group in (1, 3))
    assert low / 2 < json.loads(printed.out)["seconds"] < high * 2
