"""The causes of a run as a list: what its strategy found, and what triage says of the scenes that show it."""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from vlafuzz.common.plugins import trust_flag
from vlafuzz.common.text import count_of, interval, percent, plural
from vlafuzz.failures.triage.oracle import ONE_HALF
from vlafuzz.failures.triage.pipeline import hours
from vlafuzz.model.evidence import Rate, Solver
from vlafuzz.model.outcome import Verdict
from vlafuzz.report.cards import Spaces, card_of_finding, card_of_triaged
from vlafuzz.report.view import Card, Table, title_of
from vlafuzz.search.probability import Probability
from vlafuzz.store.records import Finding, FoundCause, Run, Triaged
from vlafuzz.store.store import Store

# Buckets in words, those of causes that are not confirmed last.
EVIDENCE: Mapping[str, str] = {
    "minimal": "certified",
    "witnessed": "confirmed",
    "base": "confirmed",
    "unproven": "confirmed, but the expert fails, too",
    "observed": "not certified",
    "edge": "not confirmed: edge",
    "flaky": "not confirmed: flaky",
}
_UNCONFIRMED = ("edge", "flaky")
NEARLY_NOMINAL = 0.1  # severity below which a scene is nominal but for a jitter, which adds about 0.01


@dataclass(frozen=True, kw_only=True)
class ListedCause:
    """A cause in words; those with the same certified signature are one.

    Attributes:
        conditions: one for each operator: the range that fails, or its value in ``scene``.
        bucket: of the scene after triage, ``observed`` before it.
        share: of random scenes that fail for this reason; of several causes in one the largest. failures: of the run
        that it explains.
        rate: how often the policy fails around ``scene``.
        witness: who solves ``scene``.
        scene: digest of the minimal scene, or without one of the failure that shows the cause. found: digests of the
        failures that show it.
        detail: the evidence, in a sentence.
    """

    conditions: tuple[str, ...]
    lost_stage: str | None = None
    share: Probability | None = None
    failures: int
    bucket: str = "observed"
    signature: str | None = None
    rate: Rate | None = None
    witness: Solver | None = None
    scene: str | None = None
    found: tuple[str, ...] = ()
    detail: str

    @property
    def says(self) -> str:
        """All but the conditions, in a line: stage, shares, evidence and scene."""
        row = {name: value for name, value in self.row().items() if value != "–"}
        parts = [f"loses {row['loses']}"] if "loses" in row else []
        parts += [f"{row['share']} of random scenes"] if "share" in row else []
        parts.append(f"explains {plural(self.failures, 'failure')}")
        fails = f": fails {row['fails']}" if "fails" in row else ""
        solved = f", solved by {self.witness}" if self.witness else ""
        parts.append(f"{row['evidence']}{fails}{solved}")
        return " · ".join([*parts, *([str(row["scene"])] if "scene" in row else [])])

    def row(self) -> dict[str, object]:
        """The columns of a table."""
        rate = self.rate
        return {
            "cause": "\n".join(self.conditions),
            "loses": self.lost_stage or "–",
            "explains": self.failures,
            "share": _estimate(self.share) if self.share else "–",
            "evidence": EVIDENCE[self.bucket],
            "fails": count_of(rate.failures, rate.rollouts, rate.low, rate.high) if rate else "–",
            "solved by": self.witness or "–",
            "scene": self.scene[:12] if self.scene else "–",
        }


@dataclass(frozen=True, kw_only=True)
class CauseList:
    """The causes of a run: confirmed ones first, then by share of random scenes, else by failures explained.

    Attributes:
        of: policy and task of the run, in words.
        unexplained: failures of the run for which no cause was found.
        probability: that the policy fails in a random scene; None if unknown.
        found: number of causes before those with the same signature became one; ``certified`` of them are. rollouts: of
        the policy, to triage their scenes; not part of the run's budget.
        certify: the command that certifies those that are not triaged, with how long it takes. nominal: how often the
        policy fails in nominal scenes, to follow that there is no cause.
    """

    run: int
    of: str
    causes: tuple[ListedCause, ...]
    unexplained: int
    probability: Probability | None
    found: int
    certified: int
    rollouts: int
    certify: str = ""
    nominal: str = ""

    @property
    def shown(self) -> str | None:
        """The scene of the first cause that has one."""
        return next((cause.scene for cause in self.causes if cause.scene), None)

    @property
    def sentences(self) -> tuple[str, ...]:
        """All but the causes themselves."""
        found = [] if self.causes else [f"no cause was found{self.nominal}"]
        if self.rollouts:
            distinct = sum(cause.bucket == "minimal" for cause in self.causes)
            same = "" if distinct == self.certified else f", {distinct} of them distinct"
            of = plural(self.found, "cause")
            found.append(f"{plural(self.rollouts, 'more rollout')} certified {self.certified} of {of}{same}")
        if self.certify:
            suspected = "a few single rollouts suggest these operators, which may be wrong or too many"
            found.append(f"not certified means: {suspected}; {self.certify} certifies them")
        tried = ", variants tried to explain them not counted" if self.unexplained else ""
        found.append(f"unexplained failures: {self.unexplained}{tried}")
        if self.probability:
            found.append(f"failure probability of random scenes: {_estimate(self.probability)}")
        return tuple(found)

    @property
    def table(self) -> Table:
        """The causes; the share is left out where none is known."""
        rows = [cause.row() for cause in self.causes]
        if not any(cause.share for cause in self.causes):
            rows = [{head: value for head, value in row.items() if head != "share"} for row in rows]
        says = "; ".join(self.sentences)
        return Table(f"Causes of run {self.run}: {self.of}", rows, f"{says[0].upper()}{says[1:]}.")

    def document(self) -> dict[str, Any]:
        """As JSON: ``causes``, ``unexplained``, ``probability`` and ``certification``."""
        return {
            "causes": [asdict(cause) | {"share": _named(cause.share)} for cause in self.causes],
            "unexplained": self.unexplained,
            "probability": _named(self.probability),
            "certification": {"causes": self.found, "certified": self.certified, "rollouts": self.rollouts},
        }


def causes_of(store: Store, run: Run, spaces: Spaces | None = None) -> CauseList | None:
    """The causes of a run; None if its strategy does not look for causes."""
    kept = store.causes(run.id)
    if kept is None:
        return None
    findings = {finding.scene: finding for finding in store.findings(run.id)}
    keys = {findings[cause.scene].key for cause in kept.causes if cause.scene in findings}
    triaged = {row.scene: row for row in store.triaged() if row.key in keys}
    maker = _Maker(store, run, spaces or Spaces(store.path))
    merged: dict[object, ListedCause] = {}
    for number, cause in enumerate(kept.causes):
        finding = findings.get(cause.scene) if cause.scene else None
        row = triaged.get(cause.scene) if cause.scene else None
        one = maker.make(cause, finding, row)
        certain = one.bucket in ("minimal", "base")
        key = (one.signature, maker.target_types(cause, row)) if certain else number
        merged[key] = _united(merged[key], one) if key in merged else one
    listed = tuple(sorted(merged.values(), key=_rank))
    return CauseList(
        run=run.id,
        of=title_of([run.manifest]),
        causes=listed,
        unexplained=kept.unexplained,
        probability=kept.probability,
        found=len(kept.causes),
        certified=sum(cause.scene in triaged and triaged[cause.scene].bucket == "minimal" for cause in kept.causes),
        rollouts=sum(row.policy_rollouts for row in triaged.values()),
        certify="" if run.status == "running" else _certify(store, run, listed),
        nominal="" if listed else _nominal(store, run),
    )


def _nominal(store: Store, run: Run) -> str:
    """Say how often a policy fails in a run's nominal scenes, jittered ones included; empty if it passes."""
    near = (trial for trial in store.trials(run.id) if trial.severity < NEARLY_NOMINAL)
    outcomes = [trial.outcome for trial in near if trial.outcome.verdict >= Verdict.PASSED]
    lost = Counter(outcome.lost_stage for outcome in outcomes if outcome.lost_stage)
    if not lost:
        return ""
    failures = f"{lost.total()} of {len(outcomes)} nominal scenes fail, mostly at {lost.most_common(1)[0][0]}"
    return f"; {failures}, and nothing that varies is shown to change that"


def _certify(store: Store, run: Run, causes: Sequence[ListedCause]) -> str:
    left = sum(cause.bucket == "observed" and cause.scene is not None for cause in causes)
    trust = trust_flag(run.manifest.policy)
    command = shlex.join(["vlafuzz", "triage", str(store.path), "--limit", str(left), *trust])
    return f"`{command}`{hours(store, left)}" if left else ""


def all_causes(store: Store) -> tuple[CauseList, ...]:
    """The causes of every run whose strategy looks for them."""
    spaces = Spaces(store.path)
    lists = (causes_of(store, run, spaces) for run in store.runs())
    return tuple(one for one in lists if one is not None)


def first_shown(store: Store, label: str | None = None) -> str | None:
    """The scene that the newest run with failures names at its end: of a cause, else its first failure.

    Runs of the label come first.
    """
    newest = reversed(store.runs())
    for run in sorted(newest, key=lambda run: label not in (None, run.manifest.named)):
        found = causes_of(store, run)
        failed = (trial for trial in store.trials(run.id) if trial.outcome.verdict is Verdict.FAILED)
        if shown := (found and found.shown) or next((trial.scene.digest for trial in failed), None):
            return shown
    return None


class _Maker:
    def __init__(self, store: Store, run: Run, spaces: Spaces) -> None:
        self._path, self._run, self._spaces = store.path, run.manifest, spaces

    def make(self, cause: FoundCause, finding: Finding | None, triaged: Triaged | None) -> ListedCause:
        if finding is None:
            detail = "no stored failure has these operators alone"
            return ListedCause(conditions=cause.operators, share=cause.share, failures=cause.failures, detail=detail)
        card, rate = self._card(finding, triaged), None
        if triaged:
            rate = triaged.certified if card.bucket == "minimal" else triaged.rate
        return ListedCause(
            conditions=self._conditions(cause, card, triaged),
            lost_stage=card.lost_stage,
            share=cause.share,
            failures=cause.failures,
            bucket=card.bucket,
            signature=card.signature or None,
            rate=rate,
            witness=card.witness.solver if card.witness else None,
            scene=card.scene.digest,
            found=card.findings,
            detail=card.detail,
        )

    def target_types(self, cause: FoundCause, triaged: Triaged | None) -> tuple[str, ...]:
        """The objects that are part of the cause, of those whose type may vary."""
        without = self._without_types(triaged)
        space = self._spaces.of(self._run)
        if cause.scene is None or space.subject not in cause.operators:
            return ()
        if without and without.low > ONE_HALF:  # it fails with the nominal objects, too
            return ()
        return tuple(space.subjects(cause.scene))

    def _conditions(self, cause: FoundCause, card: Card, triaged: Triaged | None) -> tuple[str, ...]:
        """What it takes, in words: of a certified cause what is left, else what the strategy blames."""
        subjects, certified = ", ".join(self.target_types(cause, triaged)), card.bucket == "minimal"
        parts = list[str]()
        if subjects:
            evidence = _types_evidence(self._without_types(triaged)) * certified
            parts.append(f"{self._spaces.of(self._run).subject}: {subjects}{evidence}")
        if card.bucket == "base":
            return (*parts, "fails at nominal")
        directions = {one.operator: f" ({one.direction})" for one in card.causes.thresholds if one.direction}
        for part in card.deviations:
            if part.operator in (card.operators if certified else cause.operators):
                name = part.operator + directions.get(part.operator, "")
                parts.append(f"{name}: {part.range}")
        return tuple(parts) or cause.operators

    def _without_types(self, triaged: Triaged | None) -> Rate | None:
        """How often the policy fails with the nominal targets in the scene; None if that was not tried."""
        return triaged.counterpart_rates.get(self._spaces.of(self._run).subject) if triaged else None

    def _card(self, finding: Finding, triaged: Triaged | None) -> Card:
        about = finding, self._run, self._spaces.of(self._run)
        if triaged is None:
            return card_of_finding(self._path, *about)
        return card_of_triaged(self._path, triaged, *about)


def _types_evidence(without: Rate | None) -> str:
    if without is None or not without.rollouts:
        return " (not certified)"
    counts = f"with the nominal objects {without.failures} of {without.rollouts} rollouts fail"
    return f" ({'not certified: ' * (without.high >= ONE_HALF)}{counts})"


def _united(one: ListedCause, other: ListedCause) -> ListedCause:
    first, second = sorted((one, other), key=_rank)
    return replace(first, failures=one.failures + other.failures, found=first.found + second.found)


def _rank(cause: ListedCause) -> tuple[bool, float, int]:
    return (cause.bucket in _UNCONFIRMED, -cause.share.value if cause.share else 0.0, -cause.failures)


def _estimate(estimate: Probability) -> str:
    return f"{percent(estimate.value)} ({interval(estimate.low, estimate.high)})"


def _named(estimate: Probability | None) -> dict[str, float] | None:
    return estimate._asdict() if estimate else None
