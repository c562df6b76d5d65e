"""The command line. The module of a command is imported when it is called, so that others start fast."""

import functools
import importlib
import re
import sys
import traceback
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Annotated, Any

import typer
from typer.core import TyperCommand

from vlafuzz import __version__
from vlafuzz.cli.ending import CLOSED, INTERRUPTED, Checked, StdoutError, ending_in_order, heard, is_late
from vlafuzz.cli.help import epilog, grouped
from vlafuzz.cli.trust import named
from vlafuzz.common.plugins import trust, trusting
from vlafuzz.errors import UsageError, VlafuzzError, sentence

BUG = 70  # the exit code of a traceback

# Name of each command, where it is, and what it does.
COMMANDS = {
    "run": ("vlafuzz.cli.run:command", "Fuzz a policy: find scenes in which it fails."),
    "compare": ("vlafuzz.cli.compare:command", "Compare strategies at equal budget, with statistics."),
    "study": ("vlafuzz.cli.study:command", "Do an experiment of the VLATest paper with policies."),
    "triage": ("vlafuzz.cli.triage:command", "Find out which failures can be trusted, and what causes them."),
    "findings": (
        "vlafuzz.cli.findings:command",
        "List the findings of a store: causes, evidence, next steps.",
    ),
    "replay": ("vlafuzz.cli.replay:command", "Run one scene or finding again and show it."),
    "lint": ("vlafuzz.cli.scenes:lint", "Check whether the scenes of a file are fair."),
    "coverage": ("vlafuzz.cli.scenes:coverage", "Measure how much of the space scenes or runs cover."),
    "import": ("vlafuzz.cli.scenes:app", "Import scenes of other formats."),
    "export": ("vlafuzz.cli.export:export", "Write the failing scenes of a store to a file."),
    "regress": ("vlafuzz.cli.regress:command", "Check whether a policy got worse on an exported corpus."),
    "diff": ("vlafuzz.cli.diff:command", "Compare two policies by their causes: fixed, remaining, new."),
    "bisect": ("vlafuzz.cli.bisect:command", "Find out which of several checkpoints broke a policy."),
    "read": ("vlafuzz.cli.read:command", "Read the logs of an evaluation: rates, repeats, two compared."),
    "watch": ("vlafuzz.cli.watch:command", "Follow a run on a page in the browser."),
    "report": ("vlafuzz.cli.report:command", "Write the findings as one HTML page."),
    "merge": ("vlafuzz.cli.export:merge", "Merge the runs of several stores into one."),
    "operators": ("vlafuzz.cli.listings:operators", "List the operators and their ranges."),
    "objects": ("vlafuzz.cli.listings:objects", "List the objects of the catalogue."),
    "strategies": ("vlafuzz.cli.policies:strategies", "List the strategies that propose scenes."),
    "policies": ("vlafuzz.cli.policies:policies", "List the policies that can be tested."),
    "serve": ("vlafuzz.cli.policies:serve", "Serve a policy to clients of other tools."),
    "doctor": (
        "vlafuzz.cli.doctor:doctor",
        "Check this machine, or with --policy a policy: does it see, hear, work?",
    ),
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
            Checked(sys.stdout).flush()
        except StdoutError as error:
            return (
                error.exit_code if error.exit_code == CLOSED else _complain(str(error), None, error.exit_code)
            )
    return code


def _run(arguments: Sequence[str] | None) -> int:
    try:
        words = _renamed(sys.argv[1:] if arguments is None else arguments)
        _check_filled(words)
        with trusting():  # what the command's flags name
            ended = app(args=words or ["--help"], prog_name="vlafuzz", standalone_mode=False)
    except VlafuzzError as error:
        return _complain(error.message, error.hint, error.exit_code)
    except _WrongUsage as error:
        return _complain(
            error.format_message() or "a command is missing",
            "`vlafuzz COMMAND --help` says what it takes",
            error.exit_code,
        )
    except typer.Abort:
        return _complain("interrupted", None, INTERRUPTED)
    except StdoutError:
        raise
    except SystemExit as exit_:  # typer raises none, but rich does for a help text that nobody reads
        if isinstance(exit_.__context__, BrokenPipeError):
            return CLOSED
        return _complain(
            f"a policy or strategy ended the process: sys.exit({exit_.code!r})", "raise errors", 2
        )
    except Exception as error:  # its exit code must not be 1, which means findings
        if isinstance(error, OSError) and error.filename:  # such as a name of 300 characters
            return _complain(f"{error.filename}: {error.strerror}", "check the path, and the disk", 2)
        traceback.print_exc()
        return BUG
    silent = ended == INTERRUPTED or is_late()  # typer exits without a word
    if heard() and silent:
        return _complain("interrupted", None, INTERRUPTED)
    return ended if isinstance(ended, int) else 0


def _renamed(arguments: Sequence[str]) -> list[str]:
    """The arguments under today's names: up to version 0.1 a policy was called a subject."""
    words = ["policies" if (place, word) == (0, "subjects") else word for place, word in enumerate(arguments)]
    return [re.sub(r"^--subject(?==|$)", "--policy", word) for word in words]


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
        bool,
        typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version and exit."),
    ] = False,
) -> None:
    pass


def _register(name: str, target: str, summary: str) -> None:
    class Deferred(TyperCommand):
        def make_context(
            self, info_name: str | None, args: list[str], parent: Any = None, **extra: Any
        ) -> Any:
            command = _load(name, target)
            trust(*named(command, args))
            return command.make_context(info_name, args, parent, **extra)

    app.command(name, cls=Deferred, help=summary)(lambda: None)


def _load(name: str, target: str) -> Any:
    module, _, attribute = target.partition(":")
    command = getattr(importlib.import_module(module), attribute)
    if not isinstance(command, typer.Typer):
        command = _with_stdout_for_data(command)
        single = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
        single.command(name, epilog=epilog(name))(command)
        return grouped(typer.main.get_command(single))
    return typer.main.get_command(command)


def _with_stdout_for_data(command: Callable[..., Any]) -> Callable[..., Any]:
    @functools.wraps(command)
    def called(*given: Any, **named: Any) -> Any:
        from vlafuzz.cli.output import stdout_for_data

        with stdout_for_data():
            return command(*given, **named)

    return called


for _name, (_target, _summary) in COMMANDS.items():
    _register(_name, _target, _summary)
