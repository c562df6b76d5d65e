"""Tally: the counts of a run in progress. Summary: its result, the JSON of ``run --json``."""

import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from vlafuzz.common.text import plural
from vlafuzz.failures.events import failed_before
from vlafuzz.model import Outcome, Scene, Verdict
from vlafuzz.store.records import Manifest, Trial


@dataclass(frozen=True, kw_only=True)
class Summary:
    """The result of a run. Scenes are counted once, however often they were proposed.

    Attributes:
        budget: of rollouts; a scene takes ``repeats`` of them.
        duplicates: proposals answered with a stored outcome, of this run or an earlier one.
        earlier: distinct scenes answered by an earlier run.
        verdicts: distinct scenes by verdict.
        invalid: distinct scenes by the check that rejects them.
        before_event: distinct scenes that failed before any of their events had begun.
        first_failure: digest of the first scene that failed.
        stopped: why the run ended before its budget was spent, in a sentence.
        seconds: wall time.
    """

    run: int
    task: str
    policy: str
    label: str
    strategy: str
    seed: int
    budget: int
    repeats: int
    rollouts: int
    proposals: int
    duplicates: int
    earlier: int
    verdicts: dict[str, int]
    invalid: dict[str, int]
    findings: int
    before_event: int
    first_failure: str | None
    first_error: str | None
    stopped: str | None
    checkup: str
    seconds: float
    store: str

    @property
    def unjudged(self) -> str | None:
        """Why no scene passed or failed, in a sentence; None where one did."""
        if self.verdicts["passed"] + self.verdicts["failed"]:
            return None
        if not (errors := self.verdicts["error"]):
            return "no scene could be judged"
        which = "the only rollout" if errors == 1 else f"all {errors} rollouts"
        return f"no scene could be judged: {which} ended in an error, first: {self.first_error}"

    @property
    def short(self) -> str | None:
        """How far errors kept the run from its budget, in a sentence; None if time or budget ended it."""
        if self.unjudged or self.stopped == TIME_OVER:
            return self.unjudged
        if not (errors := self.verdicts["error"]) or self.rollouts + self.repeats > self.budget:
            return None
        judged = f"{self.rollouts} of {plural(self.budget, 'rollout')} could be judged"
        return f"{judged}: {plural(errors, 'scene')} ended in an error, first: {self.first_error}"


_OF_MANIFEST = ("task", "policy", "strategy", "seed", "budget", "repeats", "checkup")
_OF_TALLY = ("run", "rollouts", "proposals", "duplicates", "earlier", "first_error", "stopped")


TIME_OVER = "its time is over; with --resume it goes on"


class _Seen(NamedTuple):
    """The first proposal of a scene and its last outcome: an ERROR may be followed by a verdict."""

    first: int
    verdict: Verdict
    check: str
    early: bool  # failed before any of its events had begun


class Tally:
    """Counts trials as they are stored, and judges whether proposals still lead to rollouts.

    Args:
        before: seconds that the run has taken already.

    Attributes:
        causes: found so far; None if the strategy does not look for causes.
    """

    def __init__(self, run: int, manifest: Manifest, before: float) -> None:
        self.run, self.manifest = run, manifest
        self._began = time.perf_counter() - before
        self.rollouts = self.proposals = self.duplicates = self.earlier = 0
        self.first_error: str | None = None
        self.stopped: str | None = None
        self.causes: int | None = None
        self.verdicts: Counter[Verdict] = Counter()
        self._seen: dict[str, _Seen] = {}
        self._asked: set[str] = set()
        self._barren: Counter[str] = Counter()  # proposals in a row without a rollout, by the reason
        self._last = ""

    def count(self, trial: Trial) -> None:
        outcome, digest = trial.outcome, trial.scene.digest
        self.proposals += 1
        self.duplicates += trial.duplicate
        self.rollouts += 0 if trial.duplicate else len(outcome.rollouts)
        before, first = self._seen.get(digest), trial.proposal
        self.earlier += trial.duplicate and before is None
        if before is not None:
            self.verdicts[before.verdict] -= 1
            first = min(first, before.first)
        self.verdicts[outcome.verdict] += 1
        self._seen[digest] = _Seen(first, outcome.verdict, outcome.check, failed_before(trial.scene, outcome))
        if outcome.verdict is Verdict.ERROR:
            self.first_error = self.first_error or outcome.detail

    def judge(self, scenes: Sequence[Scene], outcomes: Sequence[Outcome], patience: int | None) -> None:
        """Stop after ``patience`` proposals in a row without a rollout.

        A scene that an earlier run rolled out counts as a rollout, so that a repeated run ends at its budget.
        """
        for scene, outcome in zip(scenes, outcomes, strict=True):
            if scene.digest in self._asked:
                self._barren["asked before"] += 1
            elif outcome.rollouts:
                self._barren.clear()
                self._last = ""
            else:
                invalid = outcome.verdict is Verdict.INVALID
                reason = f"rejected by the {outcome.check} check" if invalid else "policy or simulator error"
                self._barren[reason] += 1
                self._last = f"; the last of them: {outcome.detail}"
            self._asked.add(scene.digest)
        number = self._barren.total()
        if patience is not None and number >= patience:
            counts = ", ".join(f"{reason} ({count})" for reason, count in self._barren.most_common())
            self.stopped = f"no rollout in {number} proposals in a row: {counts}{self._last}"

    @property
    def seconds(self) -> float:
        """Wall time of the run so far."""
        return time.perf_counter() - self._began

    def summary(self, store: str) -> Summary:
        """The result so far."""
        manifest, scenes = self.manifest, self._seen.values()
        failed = {digest: seen.first for digest, seen in self._seen.items() if seen.verdict is Verdict.FAILED}
        verdicts = sorted(Verdict, reverse=True)
        return Summary(
            **{name: getattr(manifest, name) for name in _OF_MANIFEST},
            label=manifest.named,
            **{name: getattr(self, name) for name in _OF_TALLY},
            verdicts={verdict.name.lower(): self.verdicts[verdict] for verdict in verdicts},
            invalid=dict(sorted(Counter(seen.check for seen in scenes if seen.check).items())),
            findings=len(failed),
            before_event=sum(seen.early for seen in scenes),
            first_failure=min(failed, key=failed.__getitem__, default=None),
            seconds=self.seconds,
            store=store,
        )
