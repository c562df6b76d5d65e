"""The command line. The module of a command is imported when it is called, so that others start fast."""

import importlib
import os
import re
import sys
import traceback
from collections.abc import Sequence
from itertools import pairwise
from typing import Annotated, Any

import typer
from typer.core import TyperCommand

from vlafuzz import __version__
from vlafuzz.cli.ending import CLOSED, INTERRUPTED, ending_in_order
from vlafuzz.common.plugins import EVERYTHING, trust, trusting
from vlafuzz.errors import UsageError, VlafuzzError, sentence

BUG = 70  # the exit code of a traceback

# Name of each command, behind "list" if it is one of these; where it is, and what it does.
COMMANDS = {
    "run": ("vlafuzz.cli.run:command", "Fuzz a policy: find scenes in which it fails."),
    "compare": ("vlafuzz.cli.compare:command", "Compare strategies at equal budget, with statistics."),
    "triage": ("vlafuzz.cli.triage:command", "Find out which failures can be trusted, and what causes them."),
    "report": (
        "vlafuzz.cli.report:command",
        "List what was found, write it as one HTML page, or follow a run in the browser.",
    ),
    "replay": ("vlafuzz.cli.replay:command", "Run one scene or failure again and show it."),
    "export": ("vlafuzz.cli.export:export", "Write scenes and corpora to files, also of other formats."),
    "regress": ("vlafuzz.cli.corpora:regress", "Check whether a policy got worse on an exported corpus."),
    "diff": ("vlafuzz.cli.corpora:diff", "Compare two policies by their causes: fixed, remaining, new."),
    "bisect": ("vlafuzz.cli.corpora:bisect", "Find out which of several checkpoints broke a policy."),
    "confirm": ("vlafuzz.cli.corpora:confirm", "Say which certified causes hold in another world, too."),
    "lint": ("vlafuzz.cli.lint:lint", "Check whether the scenes of a file are fair."),
    "serve": ("vlafuzz.cli.serve:serve", "Serve a policy to clients of other tools."),
    "doctor": ("vlafuzz.cli.doctor:doctor", "Check this machine, or with --policy a policy: does it see, hear, work?"),
    "list operators": ("vlafuzz.cli.lists:operators", "The operators and their ranges."),
    "list objects": ("vlafuzz.cli.lists:objects", "The objects of the catalogue."),
    "list strategies": ("vlafuzz.cli.lists:strategies", "The strategies that propose scenes."),
    "list policies": ("vlafuzz.cli.lists:policies", "The policies that can be tested."),
    "list worlds": ("vlafuzz.cli.lists:worlds", "The worlds, with their tasks and robots."),
}

app = typer.Typer(
    name="vlafuzz",
    help="Find scenes in which a vision-language-action policy fails.",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


# click's; newer typer versions carry their own copy of click
_WrongUsage: Any = typer.BadParameter.__base__


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code. Expected errors print a sentence, bugs a traceback."""
    with ending_in_order():
        try:
            code = _run(arguments)
            sys.stdout.flush()
        except BrokenPipeError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # for Python's flush at its end
            return CLOSED
    return code


def _run(arguments: Sequence[str] | None) -> int:
    try:
        words = list(sys.argv[1:] if arguments is None else arguments)
        _check_filled(words)
        with trusting():  # what the command's flags name
            ended = app(args=words or ["--help"], prog_name="vlafuzz", standalone_mode=False)
    except VlafuzzError as error:
        return _complain(error.message, error.hint, error.exit_code)
    except _WrongUsage as error:
        problem, hint = error.format_message() or "a command is missing", "`vlafuzz COMMAND --help` says what it takes"
        return _complain(problem, hint, error.exit_code)
    except typer.Abort:
        return _complain("interrupted", None, INTERRUPTED)
    except SystemExit as exit_:  # of typer and rich for what nobody reads
        if isinstance(exit_.__context__, BrokenPipeError):
            return CLOSED
        return _complain(f"a policy or strategy ended the process: sys.exit({exit_.code!r})", "raise errors", 2)
    except Exception as error:  # its exit code must not be 1, which means findings
        if isinstance(error, OSError) and error.filename:  # such as a name of 300 characters
            return _complain(f"{error.filename}: {error.strerror}", "check the path, and the disk", 2)
        traceback.print_exc()
        return BUG
    return ended if isinstance(ended, int) else 0


def _check_filled(words: Sequence[str]) -> None:
    """Refuse empty values: an unset shell variable must not select a default."""
    for before, argument in pairwise(["vlafuzz", *words]):
        if argument == "" or re.fullmatch("--[a-z-]+=", argument):
            flag = argument.rstrip("=") or before
            raise UsageError(f"nothing behind {flag!r}", hint="is a shell variable unset? give a value")


def _complain(message: str, hint: str | None, exit_code: int) -> int:
    sys.stderr.write(f"error: {sentence(message)}\n" + (f"hint: {hint}\n" if hint else ""))
    return exit_code


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"vlafuzz {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    pass


def _register(group: typer.Typer, name: str, command: str, summary: str) -> None:
    class Deferred(TyperCommand):
        def make_context(self, info_name: str | None, args: list[str], parent: Any = None, **extra: Any) -> Any:
            loaded = load(command)
            trust(*named(loaded, args))
            return loaded.make_context(info_name, args, parent, **extra)

    group.command(name, cls=Deferred, help=summary)(lambda: None)


def load(name: str) -> Any:
    """The command of that name, with its module imported."""
    from vlafuzz.cli.output import stdout_for_data

    module, _, attribute = COMMANDS[name][0].partition(":")
    command = getattr(importlib.import_module(module), attribute)
    single = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    single.command(name)(stdout_for_data()(command))
    return typer.main.get_command(single)


def named(command: Any, words: Sequence[str]) -> list[str]:
    """The policies and strategies that flags among the words behind a command name, and ``EVERYTHING`` for ``--trust``.

    A positional word is never among them, nor a value of ``--checkpoints``: a pattern such as ``*`` becomes names of
    files, which somebody else may have chosen.
    """
    given, *_ = command.make_parser(typer.Context(command)).parse_args(list(words))
    options = {param.name for param in command.params if param.param_type_name == "option"}
    found: list[str] = []
    for flag in ("policy", "policy_a", "policy_b", "baseline", "strategy", "strategies"):
        value = given.get(flag) if flag in options else None
        for name in [value] if isinstance(value, str) else value or ():
            found += [one.strip() for one in name.split(",")] if flag == "strategies" else [name]
    return [*found, *[EVERYTHING] * bool(given.get("trust"))]


_lists = typer.Typer(help="List operators, objects, strategies, policies or worlds.", no_args_is_help=True)
for _command, (_, _summary) in COMMANDS.items():
    _group, _, _name = _command.rpartition(" ")
    _register(_lists if _group else app, _name, _command, _summary)
app.add_typer(_lists, name="list")
