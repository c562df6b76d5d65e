import tempfile
from dataclasses import replace
from pathlib import Path

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from tests.doubles import failed, manifest, passed, scene, trial
from vlafuzz.model.outcome import Outcome
from vlafuzz.store.store import Store

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
        self.store = Store.open(self.path, "write")
        self.trials: dict[int, list[tuple[int, str]]] = {}
        self.policies: dict[int, str] = {}
        self.known: dict[tuple[int, str], str] = {}
        self.findings: set[tuple[int, str]] = set()

    @rule(policy=st.sampled_from(["one", "other"]))
    def begin(self, policy: str) -> None:
        run = self.store.begin(manifest(policy=policy))
        self.trials[run], self.policies[run] = [], policy

    @rule(data=st.data(), which=st.integers(0, 4), verdict=st.sampled_from(sorted(VERDICTS)))
    def add(self, data: st.DataObject, which: int, verdict: str) -> None:
        if not self.trials:
            return
        run = data.draw(st.sampled_from(sorted(self.trials)))
        key = (which, self.policies[run])
        kept = replace(trial(len(self.trials[run]), VERDICTS[verdict]), scene=scene(x=which / 100))
        self.store.add(run, kept)
        self.trials[run].append((which, verdict))
        if verdict != "error":
            self.known[key] = verdict
        if verdict == "failed":
            self.findings.add(key)

    @rule()
    def reopen(self) -> None:
        self.store.close()
        self.store = Store.open(self.path, "write")

    @invariant()
    def trials_agree(self) -> None:
        for run, expected in self.trials.items():
            found = [(each.scene, each.outcome.verdict.name.lower()) for each in self.store.trials(run)]
            assert found == [(scene(x=which / 100), verdict) for which, verdict in expected]

    @invariant()
    def known_agrees(self) -> None:
        for policy in ("one", "other"):
            for which in range(5):
                known = self.store.known(scene(x=which / 100), manifest(policy=policy).key())
                assert (known and known.verdict.name.lower()) == self.known.get((which, policy))

    @invariant()
    def findings_agree(self) -> None:
        found = {(each.scene, each.policy_key) for each in self.store.findings()}
        assert found == {(scene(x=a / 100), manifest(policy=b).key()) for a, b in self.findings}

    def teardown(self) -> None:
        self.store.close()
        self.folder.cleanup()


TestStoreLikeADict = StoreLikeADict.TestCase
TestStoreLikeADict.settings = settings(max_examples=15, stateful_step_count=25, deadline=None)
