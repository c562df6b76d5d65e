import tempfile
from dataclasses import replace
from pathlib import Path

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from tests.doubles import failed, manifest, passed, scene, trial
from vlafuzz.corpus.store import Corpus
from vlafuzz.outcome import Outcome

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
