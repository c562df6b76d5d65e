"""The result of a study: arms beside their controls, as values and as a table."""

import json
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from vlafuzz.common.files import make_folder, write_whole
from vlafuzz.common.statistics import Estimate, Share, fisher, holm, newcombe, paired_difference, sign_test
from vlafuzz.common.text import Row, markdown_table, percent, points
from vlafuzz.errors import UsageError
from vlafuzz.model.outcome import Outcome, Verdict
from vlafuzz.worlds.tabletop.tasks import TASKS

JUDGED = (Verdict.PASSED, Verdict.FAILED)  # neither an error nor an invalid scene is a failure
Tried = Sequence[tuple[Hashable, Outcome]]
"""Outcomes, each with what the scenes have in common that are derived from one."""


@dataclass(frozen=True, kw_only=True)
class Arm:
    """A policy in a task, in the scenes of an arm.

    Attributes:
        stages: share of the judged scenes that reach each stage in all of their rollouts; the last one is success.
        control: success in the control's scenes; in a paired study in those from which judged ones are derived. None
            for the control itself.
        gain: success minus that of the control, with a 95 % interval.
        p: of the exact sign test on pairs, else of Fisher's; ``p_holm``: corrected for all arms of the study.
    """

    task: str
    policy: str
    arm: str
    stages: Mapping[str, Share]
    invalid: int
    errors: int
    control: Share | None = None
    gain: Estimate | None = None
    p: float | None = None
    p_holm: float | None = None

    @property
    def success(self) -> Share:
        return list(self.stages.values())[-1]


def arm(task: str, policy: str, name: str, tried: Tried, control: Tried | None = None, *, paired: bool = False) -> Arm:
    """Count an arm, and compare it with its control.

    Args:
        paired: whether the scenes of both arms are derived from the same ones, which have one control each.
    """
    verdicts = [outcome.verdict for _, outcome in tried]
    judged = [(origin, outcome) for origin, outcome in tried if outcome.verdict in JUDGED]
    counted = Arm(
        task=task,
        policy=policy,
        arm=name,
        stages={stage: _reached(stage, judged) for stage in TASKS[task].stage_names},
        invalid=verdicts.count(Verdict.INVALID),
        errors=verdicts.count(Verdict.ERROR),
    )
    if control is None:
        return counted
    before = {origin: _passed(outcome) for origin, outcome in control if outcome.verdict in JUDGED}
    if not paired:
        base = Share.of_counts(sum(before.values()), len(before))
        if not (base.of and judged):
            return replace(counted, control=base)
        counts = (counted.success.count, counted.success.of, base.count, base.of)
        gain = Estimate(counted.success.share - base.share, *newcombe(*counts))
        return replace(counted, control=base, gain=gain, p=fisher(*counts))
    pairs = [(origin, _passed(outcome) - before[origin]) for origin, outcome in judged if origin in before]
    both = list({origin: before[origin] for origin, _ in pairs}.values())
    base = Share.of_counts(sum(both), len(both))
    if not pairs:
        return replace(counted, control=base)
    gains: dict[Hashable, int] = {}
    for origin, difference in pairs:
        gains[origin] = gains.get(origin, 0) + difference
    worse, better = (sum(sign * of_origin > 0 for of_origin in gains.values()) for sign in (-1, 1))
    mean = sum(gains.values()) / len(pairs)
    gain = Estimate(mean, *paired_difference(pairs))
    return replace(counted, control=base, gain=gain, p=sign_test(worse, better))


def _passed(outcome: Outcome) -> bool:
    return outcome.verdict is Verdict.PASSED


def _reached(stage: str, judged: Tried) -> Share:
    cases = [
        (origin, all(stage in rollout.reached or rollout.success_once for rollout in outcome.rollouts))
        for origin, outcome in judged
    ]
    if len(dict(cases)) == len(cases):
        return Share.of_counts(sum(came for _, came in cases), len(cases))
    return Share.grouped(cases)


@dataclass(frozen=True)
class StudyResult:
    """The arms of a study; ``left_out``: the runs that had no scenes, and why; ``notes`` on how it was done."""

    study: str
    left_out: Sequence[str]
    arms: Sequence[Arm]
    notes: Sequence[str]

    @property
    def title(self) -> str:
        return f"{self.study}: {', '.join(dict.fromkeys(row.policy for row in self.arms))}"

    def rows(self) -> list[Row]:
        return [_row(row) for row in self.arms]

    def said(self) -> list[str]:
        """What the table does not say."""
        left_out = [f"Left out: {'; '.join(self.left_out)}."] if self.left_out else []
        return [*left_out, _SHARES, *self.notes]


_SHARES = (
    "Shares are of the scenes that were judged, with 95% intervals; unfair scenes and errors are left out. "
    "Net: success minus that of the control, the first arm, in points. p: of the exact sign test where each scene "
    "has a control, else of Fisher's; corrected for all arms (Holm)."
)


def study_result(study: str, left_out: Sequence[str], arms: Sequence[Arm], notes: Sequence[str]) -> StudyResult:
    """With p-values that are corrected for all arms."""
    adjusted = iter(holm([row.p for row in arms if row.p is not None]))
    tested = [row if row.p is None else replace(row, p_holm=next(adjusted)) for row in arms]
    return StudyResult(study, left_out, tested, notes)


def _row(row: Arm) -> Row:
    *before, _ = row.stages.items()
    gain = row.gain
    return {
        "task": row.task,
        "policy": row.policy,
        "arm": row.arm,
        "stages": ", ".join(f"{stage} {percent(share.share)}" for stage, share in before) if row.success.of else "–",
        "success": str(row.success),
        "net": gain and f"{points(gain.value)} ({points(gain.low)} to {points(gain.high)})",
        "p": None if row.p_holm is None else f"{row.p_holm:.3g}",
        "judged": row.success.of,
        "left out": row.invalid + row.errors,
    }


def write(result: StudyResult, folder: Path) -> dict[str, Any]:
    """Write JSON and Markdown, named after the study; returns the JSON."""
    make_folder(folder)
    document = asdict(result, dict_factory=_with_shares)
    markdown = "\n\n".join([f"# {result.title}", markdown_table(result.rows()), *result.said()]) + "\n"
    try:
        write_whole(folder / f"{result.study}.json", json.dumps(document, indent=1, allow_nan=False) + "\n")
        write_whole(folder / f"{result.study}.md", markdown)
    except OSError as error:
        raise UsageError(f"--out: {error}", hint="all runs are stored: the same command continues") from None
    return document


def _with_shares(fields: list[tuple[str, Any]]) -> dict[str, Any]:
    """A dataclass as JSON; a ``Share`` with the value of its share."""
    values = dict(fields)
    if {"count", "of", "low", "high"} <= values.keys():
        values["share"] = values["count"] / values["of"] if values["of"] else 0.0
    return values
