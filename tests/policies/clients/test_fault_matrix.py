"""What breaks × when: no scene fails of it, the exit code says so, and once it is mended the run goes on."""

from collections import Counter
from collections.abc import Callable, Iterator
from itertools import product
from pathlib import Path

import pytest
from _pytest.mark import ParameterSet

from tests.cli.typed import typed
from tests.policies.clients import broken
from tests.policies.clients.broken import ANSWERS, FAULTS, STEPS, Breaking, Server, bench
from vlafuzz.campaign import config
from vlafuzz.cli import main
from vlafuzz.model import Verdict
from vlafuzz.store.store import Store

pytestmark = pytest.mark.usefixtures("no_pause")
SCENES = 12
RUN = ("run", "--strategy", "random", "--unchecked", "--no-certify", "--store", "a.db")
QUICK = ("refuses", "resets", "hangs", "half", "NaN")  # a fault of each kind
FIRST, LATER = 0, 3 * STEPS + 1  # answers before the fault: none, or those of three scenes and a begun one


def _cases(*all_of: tuple[object, ...], quick: set[tuple[object, ...]]) -> list[ParameterSet]:
    """Those that are not quick are slow tests."""
    return [pytest.param(*case, marks=() if case in quick else pytest.mark.slow) for case in all_of]


@pytest.fixture(autouse=True)
def _folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(config, "make_evaluator", bench)
    for name in ("what", "place", "at", "asked"):
        monkeypatch.setattr(Breaking, name, getattr(Breaking, name))


@pytest.fixture
def server(what: str, at: int) -> Iterator[Server]:
    made = Server(what, at)
    yield made
    made.close()


def stored() -> list[tuple[str, Verdict]]:
    """The scenes of all runs with their verdicts, without those that only ended in an error."""
    if not Path("a.db").exists():
        return []
    with Store.open(Path("a.db")) as store:
        trials = [trial for run in store.runs() for trial in store.trials(run.id)]
    return [(one.scene.digest, one.outcome.verdict) for one in trials if one.outcome.verdict != Verdict.ERROR]


def breaks_and_goes_on(policy: str, judged: int, mend: Callable[[], None], capsys, *more: str) -> None:
    """The run ends with exit code 3 after so many passed scenes; what its hint says goes on with it."""
    command = [*RUN, "--policy", policy, "--budget", str(SCENES), *more]
    said = typed(capsys, command, code=3).err
    assert "error: " in said
    assert "Traceback" not in said
    before = stored()
    assert Counter(verdict for _, verdict in before) == ({Verdict.PASSED: judged} if judged else {})
    mend()
    assert main([*RUN[:1], "--resume", *RUN[-2:], "--trust"] if "--resume" in said else command) == 0
    after = stored()
    assert after[:judged] == before
    assert [verdict for _, verdict in after] == [Verdict.PASSED] * SCENES
    assert len(dict(after)) == SCENES


@pytest.mark.parametrize(
    ("what", "at"), _cases(*product(FAULTS, (FIRST, LATER)), quick={("500", FIRST), *product(QUICK, [LATER])})
)
def test_a_server_that_breaks(what: str, at: int, server: Server, capsys: pytest.CaptureFixture[str]):
    name = f"http://127.0.0.1:{server.port}/act?camera=0&execute=1&timeout=0.05&deterministic=1&version=1"
    breaks_and_goes_on(name, at // STEPS, server.mend, capsys)


@pytest.mark.parametrize("at", [FIRST])
@pytest.mark.parametrize("what", ["resets", "hangs", "500", "HTML", "half", "redirect"])
def test_a_server_that_breaks_in_the_handshake_makes_no_trial(what: str, server: Server, capsys):
    policy = f"openpi:ws://127.0.0.1:{server.port}?camera=0&timeout=0.2"
    assert typed(capsys, [*RUN, "--policy", policy], code=3).err.startswith("error: ")
    assert not Path("a.db").exists()


@pytest.mark.parametrize("at", [SCENES * STEPS])
@pytest.mark.parametrize("what", ["refuses"])
def test_a_server_that_is_gone_after_the_last_answer_is_not_missed(server: Server):
    name = f"http://127.0.0.1:{server.port}/act?camera=0&execute=1&version=1"
    assert main([*RUN, "--policy", name, "--budget", str(SCENES)]) == 0


HERE = f"python:{broken.__name__}:"
QUICK_CASES = {("rubbish", "act", LATER), ("None", "act", FIRST), ("exits", "act", LATER), ("raises", "reset", FIRST)}
QUICK_CASES |= {("raises", "make", FIRST), ("exits", "make", FIRST)}


@pytest.mark.parametrize(
    ("what", "place", "at"),
    _cases(
        *product(("rubbish", "None", "complex", *ANSWERS), ["act"], (FIRST, LATER)),
        *product(("raises", "exits"), ("make", "reset", "act"), [FIRST]),
        *product(("raises", "exits"), ["act"], [LATER]),
        quick=QUICK_CASES,
    ),
)
def test_a_policy_that_breaks(what: str, place: str, at: int, capsys: pytest.CaptureFixture[str]):
    Breaking.what, Breaking.place, Breaking.at = what, place, at
    breaks_and_goes_on(f"{HERE}Breaking", at // STEPS, lambda: setattr(Breaking, "place", ""), capsys)


@pytest.mark.parametrize("what", ["raises", "exits"])
def test_a_policy_that_cannot_be_closed_loses_nothing(what: str, capsys: pytest.CaptureFixture[str]):
    Breaking.what, Breaking.place = what, "close"
    assert main([*RUN, "--policy", f"{HERE}Breaking", "--budget", str(SCENES)]) == 0
    assert [verdict for _, verdict in stored()] == [Verdict.PASSED] * SCENES
    assert "in close" in capsys.readouterr().err


@pytest.mark.slow
def test_a_policy_whose_worker_is_killed(capsys: pytest.CaptureFixture[str]):
    breaks_and_goes_on(f"{HERE}Mortal", 0, Path("mended").touch, capsys, "--workers", "1", "--executor", "processes")
