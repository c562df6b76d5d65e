"""Output of commands: data on stdout as a table or JSON; progress and notes on stderr."""

import json as json_format
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stdout
from typing import Any, Self

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from vlafuzz.cli.ending import INTERRUPTED as INTERRUPTED
from vlafuzz.common.deadline import Deadline
from vlafuzz.common.text import duration
from vlafuzz.common.watch import Watch
from vlafuzz.errors import printable

EVERY = 30.0  # seconds at least between lines about long work where no terminal shows a bar
_data: list[Any] = []  # the stdout of the command that runs


@contextmanager
def stdout_for_data() -> Iterator[None]:
    """Keep stdout for what ``print_rows`` and others print: what a user's code prints goes to stderr."""
    _data.append(sys.stdout)
    try:
        with redirect_stdout(sys.stderr):
            yield
    except KeyboardInterrupt:  # of which typer would say nothing
        raise typer.Abort from None
    finally:
        _data.pop()


def data() -> Any:
    """The stream for data."""
    return _data[-1] if _data else sys.stdout


class _SafeConsole(Console):
    """A console whose texts, which may come from files and servers, cannot steer the terminal."""

    def __init__(self, **options: Any) -> None:
        super().__init__(highlight=False, markup=False, **options)

    def render_str(self, text: str, **options: Any) -> Text:
        return super().render_str(printable(text), **options)


def stdout() -> Console:
    """The console for data; 100 columns wide where there is no terminal."""
    console = _SafeConsole(file=data())
    if not console.is_terminal:
        console.width = 100
    return console


def stderr() -> Console:
    """The console for everything that is not data."""
    return _SafeConsole(stderr=True)


def print_lines(*lines: str, style: str = "") -> None:
    """Print sentences and commands on stdout, see ``_say``; empty ones are left out."""
    for line in filter(None, lines):
        _say(stdout(), line, style)


def _say(console: Console, text: str, style: str = "") -> None:
    """Print lines; those with a command stay in one piece, to be copied."""
    for line in text.splitlines():
        command = "`" in line or "vlafuzz " in line
        console.print(line, style=style, soft_wrap=command or not console.is_terminal)


def print_json(value: Any) -> None:
    """Print one JSON document, floats as ``repr`` writes them."""
    data().write(json_format.dumps(value, indent=2, allow_nan=False) + "\n")


def print_rows(rows: Sequence[Mapping[str, Any]], *, json: bool = False, title: str = "") -> None:
    """Print rows that have the same keys, as a table or as JSON."""
    if json:
        print_json(list(rows))
    else:
        stdout().print(table(rows, title))


def table(rows: Sequence[Mapping[str, Any]], title: str = "") -> Table:
    """Rows as a table; columns of numbers are aligned to the right."""
    table = Table(title=title or None, title_justify="left", header_style="bold")
    for key in rows[0] if rows else ["nothing"]:
        numbers = all(isinstance(row[key], int | float) for row in rows)
        whole = not table.columns and all(len(_shown(row[key])) <= 25 for row in rows)  # as names of rows have
        table.add_column(key, justify="right" if numbers else "left", overflow="fold", no_wrap=whole)
    for row in rows:
        table.add_row(*(_shown(value) for value in row.values()))
    return table


def _shown(value: Any) -> str:
    if value is None:
        return "–"
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, list | tuple):
        return ", ".join(_shown(item) for item in value)
    return str(value)


def print_list(items: Sequence[Sequence[str]], *, title: str) -> None:
    """Print numbered items of several lines, of which the last one is the small print."""
    console = stdout()
    if items:
        console.print(title, style="italic")
    for number, (*lines, small) in enumerate(items, start=1):
        grid = Table.grid(padding=(0, 1))
        grid.add_column(width=len(str(len(items))) + 1, justify="right")
        grid.add_column(overflow="fold")
        for place, line in enumerate(lines):
            grid.add_row(f"{number}." if place == 0 else "", Text(printable(line), style="bold"))
        grid.add_row("", Text(printable(small), style="dim"))
        console.print(grid)


class Bar(Watch):
    """Progress of long work on stderr: one bar at a time, and notes above it; without a terminal lines.

    Args:
        until: when the work ends at the latest.
    """

    def __init__(self, until: Deadline | None = None) -> None:
        words = TextColumn("{task.description}", markup=False)
        columns = (words, BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
        console = stderr()
        self._bar = Progress(*columns, console=console, transient=True, disable=not console.is_terminal)
        self._until = until or Deadline()
        self._task: TaskID | None = None
        self._done, self._first = 0, 0  # steps of the present work, now and when it began
        self._total: int | None = -1
        self._began = self._told = time.monotonic()

    def progress(self, description: str, done: int, total: int | None, more: str = "") -> None:
        """Move the bar; another total begins a new one. ``more`` stands behind the description."""
        now, another = time.monotonic(), total != self._total
        if another or done < self._done:
            self._first, self._began, self._told = done, now, now
        self._done, self._total = done, total
        if self._bar.disable:
            if now - self._told >= EVERY:
                self._told = now
                self.note(self._line(description, more, now - self._began))
            return
        description = printable(description + more)
        if self._task is None or another:
            self.clear()
            self._task = self._bar.add_task(description, total=total)
            self._bar.start()
        self._bar.update(self._task, completed=done, description=description)

    def _line(self, description: str, more: str, spent: float) -> str:
        """Says what is done, since when, and how long the rest will take at the same rate."""
        done, total, left = self._done, self._total, ""
        if total and self._first < done < total:
            seconds = spent * (total - done) / (done - self._first)
            left = f", about {duration(max(min(seconds, self._until.left), 0.0))} left"
        of = f"{done} of {total}" if total else str(done)
        return f"{description}: {of}{more}, {duration(spent)} so far{left}"

    @staticmethod
    def note(text: str) -> None:
        """A line above the bar."""
        _say(stderr(), text)

    def clear(self) -> None:
        """Take the bar away."""
        if self._task is not None:
            self._bar.remove_task(self._task)
            self._task = None
        self._bar.stop()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.clear()


@contextmanager
def interruptible(note: str | Callable[[], str], until: Deadline | None = None) -> Iterator[Bar]:
    """A bar; on Ctrl-C the note says what is stored and how to continue, and the exit code is 130.

    Args:
        note: the text, or what makes it where it depends on what is stored by then.
        until: when the work ends at the latest.
    """
    with Bar(until) as bar:
        try:
            yield bar
        except KeyboardInterrupt:
            bar.clear()
            bar.note(note if isinstance(note, str) else note())
            raise typer.Exit(INTERRUPTED) from None
