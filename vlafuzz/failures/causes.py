"""The causes of a run as a list: what its strategy found, and what triage says of the scenes that show it."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import chain
from typing import Any

import numpy as np

from vlafuzz.common.plugins import command
from vlafuzz.common.text import count_of, plural
from vlafuzz.failures.described import DescribedFailure, described, space_of, title_of
from vlafuzz.failures.events import Recovery, came_about, recovery_of
from vlafuzz.failures.regions import Range, shares
from vlafuzz.failures.triage.contrast import EFFECT, HOPELESS, likely
from vlafuzz.failures.triage.pipeline import hours
from vlafuzz.model import Mechanism, Rate, Scene, Solver, Space, Verdict
from vlafuzz.model.phrasing import acting
from vlafuzz.model.quantities import plain_quantity
from vlafuzz.model.space import spoken
from vlafuzz.search.probability import Probability
from vlafuzz.store.records import FoundCause, Run, Triaged
from vlafuzz.store.store import Store

# Buckets in words.
EVIDENCE: Mapping[str, str] = {
    "minimal": "certified",
    "witnessed": "confirmed",
    "observed": "not certified",
    "unproven": "not shown to be solvable",
    "flaky": "not confirmed",
}
DOUBTFUL = {"unproven": 1, "flaky": 2}  # these causes come last
# Who solves a scene, in words: by the simulator's state, or by what the camera shows.
SOLVERS: Mapping[Solver, str] = {"expert": "expert", "seeing": "camera-only expert"}
NEARLY_NOMINAL = 0.1  # severity below which a scene is nominal but for a jitter, which adds about 0.01


@dataclass(frozen=True, kw_only=True)
class ListedCause:
    """A cause in words; those with the same certified signature are one.

    Attributes:
        title: the conditions, as "fails when" goes on: ``the light is at least 5.66 times the usual``.
        conditions: one for each operator: the range that fails, or its value in ``scene``.
        bucket: of the scene after triage, ``observed`` before it.
        share: of random scenes that fail for this reason; of several causes in one the largest.
        failures: that it explains: of a certified one the random scenes of the run that failed in its range, else the
            failures that the strategy traced to it.
        rate: how often the policy fails around ``scene``.
        witness: who solves ``scene``.
        scene: digest of the minimal scene, or without one of the failure that shows the cause.
        found: digests of the failures that show it.
        detail: the evidence, in a sentence.
        mechanism: the quantity through which several operators act; the first of the conditions says it in words.
        recovers: how soon policy and solution go on after the event that is part of the cause; None without one.
    """

    title: str
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
    mechanism: Mechanism | None = None
    recovers: Recovery | None = None

    @classmethod
    def of_failure(cls, of: DescribedFailure) -> ListedCause:
        """The cause that a failure shows by itself, as one of a corpus does."""
        return cls(
            title=of.title,
            conditions=tuple(f"{part.operator}: {part.range}" for part in of.deviations),
            lost_stage=of.stage or None,
            failures=len(of.found),
            bucket=of.bucket,
            signature=of.signature,
            rate=of.rate,
            witness=of.witness.solver if of.witness else None,
            scene=of.scene.digest,
            found=of.found,
            detail=of.detail,
        )

    def explains(self, signature: str | None) -> bool:
        """Whether a signature of its task is its own, or, of a certified cause, a way of its mechanism."""
        ways = [way.replace(" ", ":") for way in self.mechanism.ways] if self.mechanism else []
        own = self.bucket == "minimal" and str(signature).rpartition("|")[2] in ways
        return own or signature == self.signature

    @property
    def says(self) -> str:
        """All but the conditions, in a line: stage, shares, evidence and scene."""
        rate = f": fails {counted(self.rate)}" if self.rate else ""
        solved = f", solved by the {SOLVERS[self.witness]}" if self.witness else ""
        parts = (
            f"fails at: {self.lost_stage}" if self.lost_stage else "",
            f"{self.share} of random scenes" if self.share else "",
            f"explains {plural(self.failures, 'failure')}",
            f"{EVIDENCE[self.bucket]}{rate}{solved}",
            f"goes on after the event: {self.recovers}" if self.recovers else "",
            self.scene[:12] if self.scene else "",
        )
        return " · ".join(filter(None, parts))

    def row(self) -> dict[str, object]:
        """The columns of a table."""
        return {
            "cause": "\n".join(self.conditions),
            "fails at": self.lost_stage or "–",
            "explains": self.failures,
            "share": str(self.share or "–"),
            "evidence": EVIDENCE[self.bucket],
            "fails": counted(self.rate) if self.rate else "–",
            "solved by": SOLVERS[self.witness] if self.witness else "–",
            "scene": self.scene[:12] if self.scene else "–",
        }


@dataclass(frozen=True, kw_only=True)
class CauseList:
    """The causes of a run: confirmed ones first, then by share of random scenes, else by failures explained.

    Attributes:
        of: policy and task of the run, in words.
        unexplained: failures of the run for which no cause was found; of ``failed`` random scenes that failed those in
            no certified range, where there are such scenes and ranges.
        probability: that the policy fails in a random scene; None if unknown.
        found: number of causes before those with the same signature became one; ``certified`` of them are.
        rollouts: of the policy, to triage their scenes; not part of the run's budget.
        certify: the command that certifies those that are not triaged, with how long it takes.
        nominal: how often the policy fails in nominal scenes, to follow that there is no cause.
        ranges: of certified causes without a mechanism, by the digest of their scene.
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
    failed: int | None = None
    ranges: Mapping[str | None, Range] = field(default_factory=dict)

    @property
    def title(self) -> str:
        return f"Causes of run {self.run}: {self.of}"

    @property
    def all_failures(self) -> str:
        """The failures that are explained or not, in words, without variants that were tried to explain them."""
        if self.failed:
            return f"{plural(self.failed, 'failure')} in random scenes"
        return plural(sum(cause.failures for cause in self.causes) + self.unexplained, "failure")

    @property
    def left(self) -> str:
        """How many failures are unexplained, in words."""
        certain = self.failed is None or all(cause.bucket == "minimal" for cause in self.causes)
        return f"unexplained{'' if certain else ' by a certified cause'}: {self.unexplained} of {self.all_failures}"

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
        found.append(self.left)
        if self.probability:
            found.append(f"failure probability of random scenes: {self.probability}")
        return tuple(found)

    def document(self) -> dict[str, Any]:
        """As JSON: ``causes``, ``unexplained``, ``probability`` and ``certification``."""
        return {
            "causes": [asdict(cause) | {"share": _named(cause.share)} for cause in self.causes],
            "unexplained": self.unexplained,
            "probability": _named(self.probability),
            "certification": {"causes": self.found, "certified": self.certified, "rollouts": self.rollouts},
        }


def all_causes(store: Store) -> tuple[CauseList, ...]:
    """The causes of every run whose strategy looks for them."""
    return tuple(one for run in store.runs() if (one := causes_of(store, run)) is not None)


def first_shown(store: Store) -> str | None:
    """The scene of the first cause of the newest run with failures, else its first failure."""
    for run in reversed(store.runs()):
        found = causes_of(store, run)
        named = (cause.scene for cause in (found.causes if found else ()) if cause.scene)
        failed = (trial for trial in store.trials(run.id) if trial.outcome.verdict is Verdict.FAILED)
        if shown := next(chain(named, (trial.scene.digest for trial in failed)), None):
            return shown
    return None


def causes_of(store: Store, run: Run) -> CauseList | None:
    """The causes of a run; None if its strategy does not look for causes."""
    kept = store.causes(run.id)
    if kept is None:
        return None
    space = space_of(store.path, run.manifest)
    findings = {finding.scene: finding for finding in store.findings(run.id)}
    keys = {findings[cause.scene].key for cause in kept.causes if cause.scene in findings}
    triaged = {row.scene: row for row in store.triaged() if row.key in keys}
    met = [(one.scene, one.outcome) for one in store.trials(run.id) if one.scene.events and one.outcome.judged]
    merged, ranges = dict[object, ListedCause](), dict[object, Range]()
    for number, cause in enumerate(kept.causes):
        finding = findings.get(cause.scene) if cause.scene else None
        if finding is None:
            merged[number] = ListedCause(
                title=_title(space, cause, ()),
                conditions=_through(space, cause.mechanism, cause.operators),
                share=cause.share,
                failures=cause.failures,
                detail="no stored failure has these operators alone",
                mechanism=cause.mechanism,
            )
            continue
        row = triaged.get(finding.scene)
        failure, types = described(store.path, finding, run.manifest, row), _target_types(space, cause, row)
        blamed = failure.operators if failure.bucket == "minimal" else cause.operators
        if (through := cause.mechanism) and failure.bucket == "minimal":  # what is left may be another cause
            amount = space.measured(failure.scene).get(through.quantity, through.threshold)
            cause = replace(cause, mechanism=through if through.holds(np.array(amount)) else None)
        one = replace(
            ListedCause.of_failure(failure),
            title=_title(space, cause, types, failure),
            conditions=_through(space, cause.mechanism, _conditions(space, cause, failure, row)),
            share=cause.share,
            failures=cause.failures,
            mechanism=cause.mechanism,
            recovers=recovery_of(met, {name.replace("-", "_") for name in blamed}, failure.recovery),
        )
        key = (one.signature, types) if one.bucket == "minimal" else number
        if key in merged:
            first, second = sorted((merged[key], one), key=lambda cause: (cause.mechanism is None, _rank(cause)))
            one = replace(first, failures=first.failures + second.failures, found=first.found + second.found)
        merged[key] = one
        if failure.bucket == "minimal" and cause.mechanism is None:
            taken = tuple(dict.fromkeys((*failure.operators, *[space.subject] * bool(types))))
            ranges.setdefault(key, Range(space, failure.scene, taken, failure.causes))
    ranges = {key: one for key, one in ranges.items() if merged[key].mechanism is None}
    drawn = set(kept.at_random)
    trials = (trial for trial in store.trials(run.id) if trial.proposal in drawn and trial.outcome.judged)
    scenes = [(came_about(trial.scene, trial.outcome), not trial.outcome.passed) for trial in trials] if drawn else []
    failing = [scene for scene, failed in scenes if failed]
    counts, unexplained = _explained(space, merged, ranges, failing)
    shared = _shared(space, merged, ranges, scenes, kept.probability)
    causes = (replace(cause, failures=counts.get(key, cause.failures)) for key, cause in shared.items())
    listed = tuple(sorted(causes, key=_rank))
    return CauseList(
        run=run.id,
        of=title_of([run.manifest]),
        causes=listed,
        unexplained=unexplained if counts else kept.unexplained,
        failed=len(failing) if counts else None,
        ranges={merged[key].scene: one for key, one in ranges.items()},
        probability=kept.probability,
        found=len(kept.causes),
        certified=sum(cause.scene in triaged and triaged[cause.scene].bucket == "minimal" for cause in kept.causes),
        rollouts=sum(row.policy_rollouts for row in triaged.values()),
        certify="" if run.status == "running" else _certify(store, run, listed),
        nominal="" if listed else _nominal(store, run),
    )


def _explained(
    space: Space, causes: Mapping[object, ListedCause], ranges: Mapping[object, Range], failing: Sequence[Scene]
) -> tuple[dict[object, int], int]:
    """How many of the scenes that failed are in the range of each certified cause, and how many in none of them."""
    inside = {key: one.holds(failing) for key, one in ranges.items()} if failing else {}
    for key, cause in causes.items():
        if failing and cause.bucket == "minimal" and (through := cause.mechanism):
            inside[key] = through.holds(
                np.array([space.measured(one).get(through.quantity, np.nan) for one in failing])
            )
    counts = {key: int(held.sum()) for key, held in inside.items()}
    return counts, int((~np.any(list(inside.values()), axis=0)).sum()) if inside else len(failing)


def _shared(
    space: Space,
    causes: Mapping[object, ListedCause],
    ranges: Mapping[object, Range],
    scenes: Sequence[tuple[Scene, bool]],
    most: Probability | None,
) -> Mapping[object, ListedCause]:
    """The causes with the shares of random scenes that fail in the printed ranges; others as the strategy has them.

    None is above that of all failures, of which it is a part.
    """
    if not ranges or not scenes:
        return causes
    found = zip(ranges, shares(space, list(ranges.values()), scenes), strict=True)
    told = {key: Probability(*map(min, share, most or Probability(1.0, 1.0, 1.0))) for key, share in found}
    return {key: replace(cause, share=told.get(key, cause.share)) for key, cause in causes.items()}


def _target_types(space: Space, cause: FoundCause, triaged: Triaged | None) -> tuple[str, ...]:
    """The objects that are part of a cause, of those whose type may vary."""
    if cause.scene is None or space.subject not in cause.operators:
        return ()
    without = _without_types(space, triaged)
    if triaged and triaged.certified and without and triaged.certified.share - without.share < EFFECT:
        return ()  # it fails with the nominal objects, too
    return tuple(space.subjects(cause.scene))


def _without_types(space: Space, triaged: Triaged | None) -> Rate | None:
    """How often the policy fails with the nominal targets in the scene; None if that was not tried."""
    return triaged.counterpart_rates.get(space.subject) if triaged else None


def _conditions(space: Space, cause: FoundCause, failure: DescribedFailure, triaged: Triaged | None) -> tuple[str, ...]:
    """What it takes, in words: of a certified cause what is left, else what the strategy blames."""
    certified, parts = failure.bucket == "minimal", list[str]()
    if subjects := ", ".join(_target_types(space, cause, triaged)):
        without, evidence = _without_types(space, triaged), ""
        if certified and without and without.rollouts:
            counts = f"with the nominal objects {without.failures} of {without.rollouts} rollouts fail"
            rate = failure.rate or without
            shown = likely(rate.failures, rate.rollouts, without.failures, without.rollouts) > 1 - HOPELESS
            evidence = f" ({'' if shown else 'not certified: '}{counts})"
        elif certified:
            evidence = " (not certified)"
        parts.append(f"{space.subject}: {subjects}{evidence}")
    ways = {one.operator: f" ({one.direction})" for one in failure.causes.thresholds if one.direction}
    for part in failure.deviations:
        if part.operator in (failure.operators if certified else cause.operators):
            way = re.sub(rf"\b{part.operator}(-|\b)", "", ways.get(part.operator, ""))  # ``+`` for ``+mass``
            parts.append(f"{part.operator}{way}: {part.range}")
    return tuple(parts) or cause.operators


def _title(space: Space, cause: FoundCause, types: Sequence[str], failure: DescribedFailure | None = None) -> str:
    """Say what the cause takes, as a sentence that begins with "fails when" goes on."""
    if cause.mechanism is not None:
        quantity = space.quantities.get(cause.mechanism.quantity) or plain_quantity(cause.mechanism.quantity)
        said = quantity.says(cause.mechanism.threshold, above=cause.mechanism.above)
        return said.replace("≥", "at least").replace("≤", "at most")
    if failure is None:
        return f"there is a change of {' and '.join(map(spoken, cause.operators))}"
    blamed = failure.operators if failure.bucket == "minimal" else cause.operators
    parts = [part.clause for part in failure.deviations if part.operator in blamed]
    target = [f"the target is {' and '.join(types)}"] if types else []
    return " and ".join([*target, *parts]) or failure.title


def _through(space: Space, mechanism: Mechanism | None, conditions: tuple[str, ...]) -> tuple[str, ...]:
    """The conditions, of a mechanism as an example behind what it is."""
    if mechanism is None:
        return conditions
    quantity = space.quantities.get(mechanism.quantity) or plain_quantity(mechanism.quantity)
    return (acting(mechanism, quantity), *(f"for example {condition}" for condition in conditions))


def _rank(cause: ListedCause) -> tuple[int, float, int]:
    return (DOUBTFUL.get(cause.bucket, 0), -cause.share.value if cause.share else 0.0, -cause.failures)


def _certify(store: Store, run: Run, causes: Sequence[ListedCause]) -> str:
    left = sum(cause.bucket == "observed" and cause.scene is not None for cause in causes)
    triage = command("triage", store.path, "--limit", left, names=[run.manifest.policy, run.manifest.task])
    return f"`{triage}`{hours(store, left)}" if left else ""


def _nominal(store: Store, run: Run) -> str:
    """Say how often a policy fails in a run's nominal scenes, jittered ones included; empty if it passes."""
    near = (trial for trial in store.trials(run.id) if trial.severity < NEARLY_NOMINAL)
    outcomes = [trial.outcome for trial in near if trial.outcome.judged]
    lost = Counter(outcome.lost_stage for outcome in outcomes if outcome.lost_stage)
    if not lost:
        return ""
    failures = f"{lost.total()} of {len(outcomes)} nominal scenes fail, mostly at {lost.most_common(1)[0][0]}"
    return f"; {failures}, and nothing that varies is shown to change that"


def counted(rate: Rate) -> str:
    return count_of(rate.failures, rate.rollouts, rate.low, rate.high)


def _named(estimate: Probability | None) -> dict[str, float] | None:
    return estimate._asdict() if estimate else None
