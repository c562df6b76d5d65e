"""What a terminal shows, and without one, how far long work is."""

import pytest

from vlafuzz.cli import output
from vlafuzz.cli.output import Bar, print_lines


@pytest.fixture
def often(monkeypatch) -> None:
    monkeypatch.setattr(output, "EVERY", 0.0)


@pytest.mark.usefixtures("often")
def test_lines_say_what_is_done_and_how_long_the_rest_takes(capsys):
    with Bar() as bar:
        bar.progress("findings", 0, 8)
        bar.progress("findings", 2, 8, ", 1 failed")
    first, second = capsys.readouterr().err.splitlines()
    assert first == "findings: 0 of 8, 0 s so far"
    assert second == "findings: 2 of 8, 1 failed, 0 s so far, about 0 s left"


def test_short_work_says_nothing_where_there_is_no_terminal(capsys):
    with Bar() as bar:
        bar.progress("scenes", 1, 2)
    assert capsys.readouterr().err == ""


@pytest.mark.usefixtures("often")
def test_fewer_steps_than_before_are_another_work(capsys):
    with Bar() as bar:
        for done in (2, 0, 1):
            bar.progress("causes", done, 4)
    assert ["left" in line for line in capsys.readouterr().err.splitlines()] == [False, False, True]


def test_in_a_terminal_sentences_are_wrapped_by_words_and_commands_stay_in_one_piece(monkeypatch, capsys):
    monkeypatch.setenv("FORCE_COLOR", "1")  # as a terminal has it
    monkeypatch.setenv("COLUMNS", "40")
    command = "then `vlafuzz triage a-store-with-a-name-that-is-long.db --limit 2`"
    print_lines("A sentence that is wider than the terminal is wrapped.", command)
    assert [line.rstrip() for line in capsys.readouterr().out.splitlines()] == [
        "A sentence that is wider than the", "terminal is wrapped.", command,
    ]  # fmt: skip
