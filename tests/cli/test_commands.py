"""What holds for every command, and its page of help."""

import re

import pytest

from tests.cli.typed import typed
from vlafuzz.cli import COMMANDS, load, main
from vlafuzz.rollouts import policies


@pytest.mark.parametrize("flags", [("--policy", ""), ("--store=",), ("--scenes", "")])
def test_an_unset_variable_is_no_default(flags: tuple[str, ...], capsys):
    assert main(["run", *flags]) == 2
    flag = flags[0].rstrip("=")
    assert f"error: nothing behind '{flag}'\n" in capsys.readouterr().err


def test_a_bug_is_a_traceback_with_a_code_of_its_own(monkeypatch, capsys):
    monkeypatch.setattr(policies, "built_in", lambda: None)
    assert "TypeError" in typed(capsys, ["list", "policies"], code=70).err


def test_an_unknown_flag_is_a_usage_error(capsys):
    assert "--budgte" in typed(capsys, ["run", "--budgte", "3"], code=2).err


def test_the_version_is_the_installed_one(capsys):
    assert re.fullmatch(r"vlafuzz \d+\.\d+\.\d+\n", typed(capsys, ["--version"]).out)


def test_help_lists_all_commands(capsys):
    shown = typed(capsys, ["--help"]).out
    for name in ("run", "replay", "lint", "export", "list", "doctor"):
        assert re.search(rf"^│ {name} ", shown, re.MULTILINE)


def test_every_command_that_is_there_has_help():
    for name in COMMANDS:
        assert main([*name.split(), "--help"]) == 0


def test_there_are_at_most_15_commands_and_run_has_at_most_22_options():
    assert len({name.split()[0] for name in COMMANDS}) <= 15
    shown = [param for param in load("run").params if not param.hidden and param.name != "help"]
    assert len(shown) <= 22
