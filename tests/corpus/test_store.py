"""The most important test in here is the one that kills a writer: what was acknowledged is on the disk."""

import os
import resource
import signal
import sqlite3
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from tests.doubles import failed, manifest, passed, rollout, scene
from vlafuzz.corpus import migrations
from vlafuzz.corpus.records import Trial
from vlafuzz.corpus.store import Corpus
from vlafuzz.errors import CorpusError
from vlafuzz.outcome import Outcome, Verdict

KEY = manifest().subject_key


def trial(proposal: int, outcome: Outcome, **fields) -> Trial:
    place = "grasp|light|x0y0" if outcome.verdict is Verdict.FAILED else None
    return Trial(proposal, scene(x=proposal / 1000), outcome, 0.5, np.array([0.1, 0.9]), place, **fields)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "runs" / "a.db"


@pytest.fixture
def corpus(path: Path):
    with Corpus.open(path, "write") as opened:
        yield opened


def test_a_run_comes_back_with_its_manifest(corpus: Corpus):
    asked = manifest(versions={"numpy": "2"}, stop_early=True, commit="abc", seed=2**62)
    number = corpus.begin(asked)
    corpus.finish(number, "finished", 1.5)
    (run,) = corpus.runs()
    assert (run.id, run.manifest, run.status, run.seconds) == (number, asked, "finished", 1.5)


def test_a_failing_trial_comes_back_bit_by_bit(corpus: Corpus):
    actions = np.random.default_rng(0).normal(size=(9, 7)).astype(np.float32)
    rolled = replace(rollout(0.25, ("grasp",)), actions=actions, trace=actions[:, 0])
    kept = trial(0, Outcome.of((rolled, rolled), ("grasp", "lift", "success")))
    run = corpus.begin(manifest())
    corpus.add(run, kept)
    (got,) = corpus.trials(run)
    assert (got.scene, got.cell, got.severity, got.duplicate) == (kept.scene, kept.cell, 0.5, False)
    assert (got.outcome.verdict, got.outcome.progress, got.outcome.lost_stage) == (Verdict.FAILED, 0.25, "lift")
    assert got.genome is not None
    assert kept.genome is not None
    assert got.genome.tobytes() == kept.genome.tobytes()
    assert len(got.outcome.rollouts) == 2
    again = got.outcome.rollouts[1]
    assert (again.reached, again.steps, again.states_hash) == (("grasp",), 9, rolled.states_hash)
    assert np.array_equal(again.actions, actions)
    assert np.array_equal(again.trace, actions[:, 0])


def test_a_passing_rollout_keeps_its_trace_but_no_actions(corpus: Corpus):
    run = corpus.begin(manifest())
    corpus.add(run, trial(0, passed()))
    (rolled,) = next(corpus.trials(run)).outcome.rollouts
    assert (rolled.steps, rolled.actions.shape) == (4, (0, 7))


def test_not_a_number_never_goes_in(corpus: Corpus, path: Path):
    broken = replace(rollout(float("nan"), ()), seconds=float("nan"))
    run = corpus.begin(manifest())
    corpus.add(run, trial(0, Outcome(Verdict.FAILED, (broken,), float("nan"), "grasp")))
    with sqlite3.connect(path) as raw:
        assert raw.execute("SELECT progress, seconds FROM trial").fetchall() == [(None, 0.0)]
        assert raw.execute("SELECT progress, seconds FROM rollout").fetchall() == [(None, 0.0)]
    raw.close()


@pytest.mark.parametrize("outcome", [passed(), failed(), Outcome.invalid("geometry", "too far")])
def test_an_evaluated_scene_is_known(corpus: Corpus, outcome: Outcome):
    kept = trial(0, outcome)
    corpus.add(corpus.begin(manifest()), kept)
    known = corpus.known(kept.scene, KEY)
    assert known is not None
    assert (known.verdict, known.progress, known.detail, known.check) == (
        outcome.verdict, outcome.progress, outcome.detail, outcome.check,
    )  # fmt: skip
    assert len(known.rollouts) == len(outcome.rollouts)


def test_an_error_is_not_known_and_may_be_tried_again(corpus: Corpus):
    run = corpus.begin(manifest())
    corpus.add(run, trial(0, Outcome.error("no answer within 10 s")))
    assert corpus.known(scene(x=0), KEY) is None


@pytest.mark.parametrize(
    "change",
    [
        {"subject": "other"},
        {"spec": '{"version": "2"}'},
        {"seed": 1},
        {"repeats": 5},
        {"criteria": "published"},
        {"stop_early": True},
        {"min_distance": 0.2},
        {"catalogue_digest": "d"},
        {"simulator": "other"},
    ],
    ids=str,
)
def test_an_outcome_says_nothing_of_other_conditions(corpus: Corpus, change: dict[str, object]):
    corpus.add(corpus.begin(manifest()), trial(0, passed()))
    assert corpus.known(scene(x=0), manifest(**change).subject_key) is None


def test_budget_batch_and_strategy_do_not_change_what_is_known():
    assert manifest(budget=7, batch=3, strategy="other", command="x").subject_key == KEY


def test_a_finding_is_kept_once_a_subject_and_listed_in_each_run_that_failed(corpus: Corpus):
    first, second, other = (corpus.begin(manifest(subject=name)) for name in ("idle", "idle", "other"))
    for run in (first, second, other):
        corpus.add(run, trial(0, failed(), duplicate=run == second))
        corpus.add(run, trial(1, passed()))
    assert [(found.run, found.proposal, found.evidence) for found in corpus.findings()] == [
        (first, 0, "observed"), (other, 0, "observed"),
    ]  # fmt: skip
    assert [found.run for found in corpus.findings(second)] == [first]
    assert [found.run for found in corpus.findings(other)] == [other]


def test_a_scene_is_found_by_the_beginning_of_its_digest(corpus: Corpus):
    kept = trial(0, passed())
    corpus.add(corpus.begin(manifest()), kept)
    assert corpus.scene(kept.scene.digest[:8].upper()) == kept.scene


def test_a_beginning_that_fits_several_scenes_or_none_is_refused(corpus: Corpus):
    run = corpus.begin(manifest())
    for proposal in range(20):
        corpus.add(run, trial(proposal, passed()))
    with pytest.raises(CorpusError, match="fits several scenes") as caught:
        corpus.scene("")
    assert "more digits" in str(caught.value.hint)
    with pytest.raises(CorpusError, match="no scene 'xyz'"):
        corpus.scene("xyz")


def test_an_unknown_run_is_refused_with_the_known_ones(corpus: Corpus):
    corpus.begin(manifest())
    with pytest.raises(CorpusError, match="no run 7") as caught:
        list(corpus.trials(7))
    assert caught.value.hint == "its runs: 1"


def test_a_second_writer_is_told_who_writes(corpus: Corpus, path: Path):
    with pytest.raises(CorpusError, match=f"process {os.getpid()} is writing to it"):
        Corpus.open(path, "write")


def test_others_read_while_one_writes(corpus: Corpus, path: Path):
    run = corpus.begin(manifest())
    with Corpus.open(path) as reader:
        corpus.add(run, trial(0, passed()))
        assert len(list(reader.trials(run))) == 1


def test_nothing_but_the_store_is_left_in_its_folder(path: Path):
    with Corpus.open(path, "write") as corpus:
        corpus.begin(manifest())
    assert [each.name for each in path.parent.iterdir()] == [path.name]


def test_it_can_be_written_again_after_it_was_closed(path: Path):
    for expected in (1, 2, 3):
        with Corpus.open(path, "write") as corpus:
            assert corpus.begin(manifest()) == expected


WRITER = """
import sys
from pathlib import Path
from tests.corpus.test_store import trial
from tests.doubles import failed, manifest
from vlafuzz.corpus.store import Corpus
with Corpus.open(Path(sys.argv[1]), "write") as corpus:
    run = corpus.begin(manifest())
    for number in range(100_000):
        corpus.add(run, trial(number, failed()))
        print(number, flush=True)
"""


def start_writer(path: Path, **options) -> subprocess.Popen[str]:
    root = Path(__file__).parents[2]
    command = [sys.executable, "-c", WRITER, str(path)]
    return subprocess.Popen(command, cwd=root, text=True, stdout=subprocess.PIPE, **options)


def test_a_killed_writer_loses_nothing_that_was_acknowledged(path: Path):
    with start_writer(path) as writer:
        assert writer.stdout is not None
        for _ in range(40):
            writer.stdout.readline()
        writer.send_signal(signal.SIGKILL)
        acknowledged = 40 + len(writer.stdout.read().split())
    with Corpus.open(path, "write") as corpus:
        kept = list(corpus.trials(1))
        assert [each.proposal for each in kept[:acknowledged]] == list(range(acknowledged))
        assert len(kept) <= acknowledged + 1
        assert all(len(each.outcome.rollouts) == 1 for each in kept)
        assert len(corpus.findings()) == len(kept)
        assert corpus.runs()[0].status == "running"


def test_a_full_disk_is_one_sentence_and_keeps_what_is_stored(path: Path):
    limited = start_writer(path, stderr=subprocess.PIPE, preexec_fn=no_room)
    told, complaint = limited.communicate(timeout=20)
    assert "CorpusError" in complaint.splitlines()[-1]
    assert "cannot be read or written" in complaint or "disk is full" in complaint
    with Corpus.open(path, "write") as corpus:
        assert len(list(corpus.trials(1))) == len(told.split())


def no_room() -> None:
    resource.setrlimit(resource.RLIMIT_FSIZE, (300_000, 300_000))


def a_text(path: Path) -> None:
    path.write_text("this is a file of words, not a database, however long one reads in it\n" * 20)


def nothing(path: Path) -> None:
    path.write_bytes(b"")


def another_database(path: Path) -> None:
    raw = sqlite3.connect(path)
    raw.execute("CREATE TABLE run (id)")
    raw.close()


def a_newer_schema(path: Path) -> None:
    Corpus.open(path, "write").close()
    raw = sqlite3.connect(path)
    raw.execute("PRAGMA user_version = 99")
    raw.close()


def written(path: Path) -> bytearray:
    with Corpus.open(path, "write") as corpus:
        run = corpus.begin(manifest())
        for number in range(30):
            corpus.add(run, trial(number, failed()))
    return bytearray(path.read_bytes())


def a_truncated_store(path: Path) -> None:
    data = written(path)
    path.write_bytes(data[: len(data) // 2])


def a_store_with_a_hole(path: Path) -> None:
    data = written(path)
    data[5000:15000] = bytes(10000)
    path.write_bytes(data)


@pytest.mark.parametrize("mode", ["read", "write"])
@pytest.mark.parametrize(
    ("make", "says"),
    [
        (a_text, "is not a store of vlafuzz"),
        (another_database, "is not a store of vlafuzz"),
        (a_newer_schema, "newer than"),
        (a_truncated_store, "is damaged"),
        (a_store_with_a_hole, "is damaged"),
    ],
)
def test_what_cannot_be_used_is_refused_in_a_sentence_and_left_alone(tmp_path: Path, make, says: str, mode):
    path = tmp_path / "a.db"
    make(path)
    before = path.read_bytes()
    with pytest.raises(CorpusError, match=says) as caught:
        Corpus.open(path, mode)
    assert caught.value.hint
    assert path.read_bytes() == before
    assert not path.with_name("a.db.lock").exists()


@pytest.mark.parametrize("make", [nothing, lambda path: None, lambda path: path.mkdir()])
def test_there_is_nothing_to_read_in_an_empty_file_no_file_or_a_folder(tmp_path: Path, make):
    make(tmp_path / "a.db")
    with pytest.raises(CorpusError):
        Corpus.open(tmp_path / "a.db")


def test_a_folder_that_cannot_be_made_is_a_sentence(tmp_path: Path):
    (tmp_path / "runs").write_text("in the way")
    with pytest.raises(CorpusError, match="cannot be written"):
        Corpus.open(tmp_path / "runs" / "a.db", "write")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_store_in_a_read_only_folder_can_be_read_but_not_written(path: Path):
    written(path)
    path.parent.chmod(0o555)
    try:
        with Corpus.open(path) as corpus:
            assert len(corpus.findings()) == 30
        with pytest.raises(CorpusError, match="cannot be written"):
            Corpus.open(path, "write")
    finally:
        path.parent.chmod(0o755)


def test_an_older_store_is_brought_up_to_date_even_to_read(path: Path, monkeypatch: pytest.MonkeyPatch):
    written(path)

    def add_a_column(connection: sqlite3.Connection) -> None:
        connection.execute("ALTER TABLE finding ADD COLUMN note TEXT")

    monkeypatch.setattr(migrations, "MIGRATIONS", [*migrations.MIGRATIONS, add_a_column])
    monkeypatch.setattr("vlafuzz.corpus.database.MIGRATIONS", migrations.MIGRATIONS)
    with Corpus.open(path) as corpus:
        assert len(corpus.findings()) == 30
    raw = sqlite3.connect(path)
    assert raw.execute("PRAGMA user_version").fetchone() == (2,)
    assert raw.execute("SELECT DISTINCT note FROM finding").fetchall() == [(None,)]
    raw.close()


def test_a_migration_that_breaks_changes_nothing(path: Path, monkeypatch: pytest.MonkeyPatch):
    written(path)

    def breaks(connection: sqlite3.Connection) -> None:
        connection.execute("DROP TABLE finding")
        raise ZeroDivisionError

    monkeypatch.setattr(migrations, "MIGRATIONS", [*migrations.MIGRATIONS, breaks])
    with pytest.raises(ZeroDivisionError):
        Corpus.open(path, "write")
    monkeypatch.undo()
    with Corpus.open(path, "write") as corpus:
        assert len(corpus.findings()) == 30


VERDICTS = {
    "passed": passed(),
    "failed": failed(),
    "invalid": Outcome.invalid("solved", "already solved"),
    "error": Outcome.error("timeout"),
}


class StoreLikeADict(RuleBasedStateMachine):
    """The store against a dict: whatever is added, and however often it is reopened, they agree."""

    @initialize()
    def empty(self) -> None:
        self.folder = tempfile.TemporaryDirectory()
        self.path = Path(self.folder.name) / "a.db"
        self.corpus = Corpus.open(self.path, "write")
        self.trials: dict[int, list[tuple[int, str]]] = {}
        self.subjects: dict[int, str] = {}
        self.known: dict[tuple[int, str], str] = {}
        self.findings: set[tuple[int, str]] = set()

    @rule(subject=st.sampled_from(["one", "other"]))
    def begin(self, subject: str) -> None:
        run = self.corpus.begin(manifest(subject=subject))
        self.trials[run], self.subjects[run] = [], subject

    @rule(data=st.data(), which=st.integers(0, 4), verdict=st.sampled_from(sorted(VERDICTS)))
    def add(self, data: st.DataObject, which: int, verdict: str) -> None:
        if not self.trials:
            return
        run = data.draw(st.sampled_from(sorted(self.trials)))
        key = (which, self.subjects[run])
        kept = replace(trial(len(self.trials[run]), VERDICTS[verdict]), scene=scene(x=which / 100))
        self.corpus.add(run, kept)
        self.trials[run].append((which, verdict))
        if verdict != "error":
            self.known[key] = verdict
        if verdict == "failed":
            self.findings.add(key)

    @rule()
    def reopen(self) -> None:
        self.corpus.close()
        self.corpus = Corpus.open(self.path, "write")

    @invariant()
    def trials_agree(self) -> None:
        for run, expected in self.trials.items():
            found = [(each.scene, each.outcome.verdict.name.lower()) for each in self.corpus.trials(run)]
            assert found == [(scene(x=which / 100), verdict) for which, verdict in expected]

    @invariant()
    def known_agrees(self) -> None:
        for subject in ("one", "other"):
            for which in range(5):
                known = self.corpus.known(scene(x=which / 100), manifest(subject=subject).subject_key)
                assert (known and known.verdict.name.lower()) == self.known.get((which, subject))

    @invariant()
    def findings_agree(self) -> None:
        found = {(each.scene, each.subject_key) for each in self.corpus.findings()}
        assert found == {(scene(x=a / 100), manifest(subject=b).subject_key) for a, b in self.findings}

    def teardown(self) -> None:
        self.corpus.close()
        self.folder.cleanup()


TestStoreLikeADict = StoreLikeADict.TestCase
TestStoreLikeADict.settings = settings(max_examples=15, stateful_step_count=25, deadline=None)
