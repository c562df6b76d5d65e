import pytest

from tests.cli.typed import told, typed
from vlafuzz.cli import lint
from vlafuzz.worlds.audit import AuditedSuite, AuditedTask, Defect

BROKEN = AuditedTask("s/1", "take the bowl", 3, (Defect(2, "slides", "bowl slides by 6.2 cm", 0.062),))
SOUND = AuditedTask("s/2", "take the can", 3, ())


@pytest.fixture
def audited(monkeypatch) -> list[AuditedTask]:
    """What the audit of any suite finds; ``toy`` is the world of this module."""
    tasks = [SOUND]
    monkeypatch.setattr(lint, "known_worlds", lambda: {"toy": Toy(tasks)})
    return tasks


class Toy:
    def __init__(self, tasks):
        self.tasks = tasks

    def audit(self, name, scope):
        return AuditedSuite(name, "Toy 1.0", tuple(self.tasks))


def test_a_sound_suite_is_fine(audited, capsys):
    assert "with Toy 1.0" in typed(capsys, ["lint", "toy:s"]).err


def test_a_defect_is_shown_with_its_state_and_fails_the_command(audited, capsys):
    audited.append(BROKEN)
    out = typed(capsys, ["lint", "-v", "toy:s"], code=1).out
    assert out.startswith("s/1 state 2: slides: bowl slides by 6.2 cm")


def test_json_has_counts_defects_and_versions(audited, capsys):
    audited.append(BROKEN)
    (suite,) = told(capsys, ["lint", "--json", "toy:s"], code=1)
    assert suite["with"] == "Toy 1.0"
    assert [task["sound"] for task in suite["tasks"]] == [3, 2]
    assert suite["tasks"][1]["slides"] == 1
    assert suite["tasks"][1]["defects"][0]["state"] == 2


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("lint --static toy:s", "--static: a suite's initial states are checked as they are"),
        ("lint toy:s x.jsonl", "files and suites at once: toy:s"),
        ("lint --states 3 x.jsonl", "--states 3: only suites have initial states"),
        ("lint --states 0 toy:s", "--states: expected at least 1, got 0"),
    ],
)
def test_what_does_not_fit_is_refused(audited, words, message, capsys):
    assert message in typed(capsys, words.split(), code=2).err


def test_without_the_packages_of_a_world_one_sentence_says_what_to_install(monkeypatch, capsys):
    monkeypatch.setattr("vlafuzz.worlds.libero.packages._NEEDED", ("no_such_package",))
    err = typed(capsys, ["lint", "libero:libero_goal"], code=3).err
    assert "not installed: no_such_package" in err
    assert "scripts/setup-libero" in err
