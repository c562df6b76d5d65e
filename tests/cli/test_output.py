"""Without a terminal, long work says now and then how far it is."""

import threading

from vlafuzz.cli.output import Bar, Heartbeat

SOON = 10.0  # seconds, within which a line is certainly written


class Lines(list[str]):
    """Collects lines, and says when there is one."""

    def __init__(self) -> None:
        super().__init__()
        self.some = threading.Event()

    def __call__(self, line: str) -> None:
        self.append(line)
        self.some.set()


def test_a_line_says_what_is_done_and_how_long_the_rest_takes():
    lines = Lines()
    beat = Heartbeat(lines, every=0.01)
    beat.tell("findings", 0, 8)
    beat.tell("findings", 2, 8)
    assert lines.some.wait(SOON)
    beat.stop()
    assert lines[-1].startswith("findings: 2 of 8, ")
    assert "left" in lines[-1]


def test_lines_come_while_one_step_takes_long():
    lines = Lines()
    beat = Heartbeat(lines, every=0.01)
    beat.tell("films", 0, None)
    for _ in range(3):
        lines.some.clear()
        assert lines.some.wait(SOON)
    beat.stop()


def test_no_line_comes_after_the_end():
    lines = Lines()
    beat = Heartbeat(lines, every=0.01)
    beat.tell("films", 1, 2)
    assert lines.some.wait(SOON)
    beat.stop()
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
