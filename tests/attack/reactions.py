"""What a reaction to bad input may be: a sentence of vlafuzz's own, and nothing that steers a terminal."""

import io
from contextlib import redirect_stderr, redirect_stdout

from vlafuzz.cli import BUG, main
from vlafuzz.errors import VlafuzzError


class TracebackError(Exception):
    """The command line printed a traceback, or something that steers a terminal."""


def command(*arguments: object) -> None:
    """Run a command; its output must be printable, and no traceback."""
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        code = main([str(argument) for argument in arguments])
    if code == BUG or "Traceback" in err.getvalue():
        raise TracebackError(err.getvalue()[-600:])
    if steering := {sign for sign in out.getvalue() + err.getvalue() if not sign.isprintable()} - {*"\n\t"}:
        raise TracebackError(f"{arguments} prints {steering}")


def is_fair(error: BaseException) -> bool:
    """Whether an error is a sentence of ours: short, and nothing in it steers a terminal."""
    if not isinstance(error, VlafuzzError):
        return False
    texts = [error.message, error.hint or "-"]
    return all(0 < len(text) <= 300 and not {*"\x1b\x07\n"} & {*text} for text in texts)
