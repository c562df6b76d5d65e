"""What holds for every command."""

import importlib.util
import re
import subprocess
import sys

import pytest

from vlafuzz.cli import main
from vlafuzz.rollouts import policies

IDLE = ("--policy", "python:tests.doubles:make_idle", "--unchecked", "--no-certify")


@pytest.mark.parametrize("flags", [("--policy", ""), ("--store=",), ("--scenes", "")])
def test_an_unset_variable_is_no_default(flags: tuple[str, ...], capsys: pytest.CaptureFixture[str]):
    assert main(["run", *flags]) == 2
    flag = flags[0].rstrip("=")
    assert f"error: nothing behind '{flag}'\n" in capsys.readouterr().err


def test_a_bug_is_a_traceback_with_a_code_of_its_own(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setattr(policies, "built_in", lambda: None)
    assert main(["policies"]) == 70
    assert "TypeError" in capsys.readouterr().err


def test_a_wrong_flag_is_noticed_before_a_simulator_is_loaded():
    code = (
        "import sys; from vlafuzz.cli import main; code = main(['run', '--budget', '0']);"
        "print(code, [name for name in ('torch', 'sapien', 'mani_skill') if name in sys.modules])"
    )
    child = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert child.stdout == "2 []\n"


def test_an_unknown_flag_is_a_usage_error(capsys: pytest.CaptureFixture[str]):
    assert main(["run", "--budgte", "3"]) == 2
    assert "--budgte" in capsys.readouterr().err


def test_the_version_is_the_installed_one(capsys: pytest.CaptureFixture[str]):
    assert main(["--version"]) == 0
    assert re.fullmatch(r"vlafuzz \d+\.\d+\.\d+\n", capsys.readouterr().out)


def test_help_lists_all_commands_without_importing_them():
    code = (
        "import sys; from vlafuzz.cli import main; main(['--help']);"
        "print([name for name in ('torch', 'numpy', 'pydantic', 'vlafuzz.cli.run') if name in sys.modules])"
    )
    child = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert child.stdout.endswith("[]\n")
    for name in ("run", "replay", "lint", "import", "export", "operators", "objects", "policies", "doctor"):
        assert re.search(rf"^│ {name} ", child.stdout, re.MULTILINE)


def test_every_command_that_is_there_has_help():
    from vlafuzz.cli import COMMANDS

    for name, (target, _) in COMMANDS.items():
        if importlib.util.find_spec(target.partition(":")[0]) is not None:
            assert main([name, "--help"]) == 0
