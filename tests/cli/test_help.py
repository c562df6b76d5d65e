"""Help pages: flags in panels, and examples that can be typed."""

import shlex

import pytest

from tests.cli.typed import typed
from vlafuzz.cli import COMMANDS, load
from vlafuzz.cli.help import EXAMPLES, MANY


@pytest.mark.parametrize("name", COMMANDS)
def test_every_flag_of_a_command_with_many_is_in_a_panel(name):
    command = load(name)
    options = [param for param in command.params if param.param_type_name == "option"]
    if len(options) > MANY:
        assert [option.name for option in options if not option.rich_help_panel] == []


@pytest.mark.parametrize("name", EXAMPLES)
def test_help_ends_with_two_examples_that_the_parser_takes(name, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "150")
    shown = typed(capsys, [name, "--help"]).out
    for example in EXAMPLES[name]:
        assert example in shown
        program, used, *words = shlex.split(example)
        assert (program, used) == ("vlafuzz", name)
        command = load(name)
        command.make_parser(command.context_class(command)).parse_args(args=words)
