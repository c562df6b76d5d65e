"""What a terminal shows, and without one, how far long work is."""

import threading

from vlafuzz.cli.output import Bar, Heartbeat, print_lines

SOON = 10.0  # seconds, within which a line is certainly written


class Lines(list[str]):
    """Collects lines, and says when there is one."""

    def __init__(self) -> None:
        super().__init__()
        self.some = threading.Event()

    def __call__(self, line: str) -> None:
        self.append(line)
        self.some.set()


def test_lines_say_what_is_done_and_how_long_the_rest_takes_until_the_end():
    lines = Lines()
    beat = Heartbeat(lines, every=0.01)
    beat.tell("findings", 0, 8)
    beat.tell("findings", 2, 8)
    for _ in range(3):  # one step takes long
        lines.some.clear()
        assert lines.some.wait(SOON)
    beat.stop()
    assert lines[-1].startswith("findings: 2 of 8, ")
    assert "left" in lines[-1]
    lines.some.clear()
    assert not lines.some.wait(0.1)


def test_short_work_says_nothing_where_there_is_no_terminal(capsys):
    with Bar() as bar:
        bar.progress("scenes", 1, 2)
    assert capsys.readouterr().err == ""


def test_fewer_steps_than_before_are_another_work():
    beat = Heartbeat(Lines(), every=60)
    beat.tell("causes", 2, 4)
    beat.tell("causes", 0, 4)
    assert "left" not in beat.line()
    beat.tell("causes", 1, 4)
    assert "left" in beat.line()
    beat.stop()


def test_in_a_terminal_sentences_are_wrapped_by_words_and_commands_stay_in_one_piece(monkeypatch, capsys):
    monkeypatch.setenv("FORCE_COLOR", "1")  # as a terminal has it
    monkeypatch.setenv("COLUMNS", "40")
    command = "`vlafuzz triage a-store-with-a-name-that-is-long.db --limit 2`"
    print_lines(f"A sentence that is wider than the terminal, then {command} certifies the rest.")
    *before, typed, after = capsys.readouterr().out.splitlines()
    assert before == ["A sentence that is wider than the", "terminal, then"]
    assert (typed, after) == (command, "certifies the rest.")
