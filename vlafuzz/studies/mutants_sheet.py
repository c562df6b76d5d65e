"""The tables and the plot of RQ3 and RQ4."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vlafuzz.studies import plots, published
from vlafuzz.studies.mutants import CURVES, EDGES, Alpha, Kept, Point
from vlafuzz.studies.sheet import BESIDE, Sheet, StudyResult, Table
from vlafuzz.text import Row, percent, points

_NOTES = (
    "Def.: scenes that the policy passed. Control: the same scenes once more, unmutated, with the seed "
    "of the mutants. Mut.: how many scenes of Def. are passed when mutated, the mean of three mutants. "
    "The interval of Mut./Def. takes into account that mutants of one scene resemble each other. Net: "
    "Mut./Def. minus the control's share, in points. Unfair mutants and errors count in no share.",
    BESIDE,
)
_DIFFERS = {
    "rq3": "it has no control arm, so that losses by chance count as effects of the light; its light changes "
    "in pick-up only, as the other environments ignore it, and its ambient light stays as it is, while "
    "here α multiplies every light in every task; it first draws dark or bright by a coin and then α "
    "linearly, {alpha}: half of its 4302 draws are dark, and a quarter are above 10.",
    "rq4": "it has no control arm; its background, a photo, changes with the camera and here it does not; it "
    "moves the camera by up to 5 cm along each of three axes (8.7 cm in all) and turns it about two "
    "axes, while here it moves by at most 5 cm in any direction and turns by up to 5° about all three.",
}
_ALPHA = {
    "linear": "as here",
    "log": "here evenly in log2, so that small changes are as frequent as large ones",
}


@dataclass(frozen=True)
class MutationResult(StudyResult):
    """The result of RQ3 or RQ4.

    Attributes:
        alpha: how it was drawn; None in RQ4.
        published: the rows of the paper's table that are known.
    """

    alpha: Alpha | None
    kept: list[Kept]
    points: list[Point]
    published: list[published.Mutated]

    def sheet(self) -> Sheet:
        """The paper's table, and curves."""
        curves = [Table(f"Mutants passed: {curve}", self._curve(curve)) for curve in CURVES[self.study]]
        tables = [
            Table("Passed by default, and of these when mutated", [_row(row) for row in self.kept]),
            *(table for table in curves if table.rows),
            Table("The paper's, as far as known", [_paper_row(row) for row in self.published]),
        ]
        differs = _DIFFERS[self.study].format(alpha=_ALPHA[self.alpha or "linear"])
        return Sheet(self.title, tables, [*_NOTES, *self.gaps], differs, self._plot)

    def _curve(self, curve: str) -> list[Row]:
        points = {
            (point.policy, point.low, point.high): point for point in self.points if point.curve == curve
        }
        spans = sorted({(low, high) for _, low, high in points})
        return [
            {"policy": policy}
            | {f"{low:g} to {high:g}": _passed(points.get((policy, low, high))) for low, high in spans}
            for policy in dict.fromkeys(name for name, *_ in points)
        ]

    def _plot(self, path: Path) -> None:
        """What is kept of each task beside the control; then the curves."""
        names = ["tasks", *CURVES[self.study]]
        figure, (first, *every) = plots.panels(self.title, names, "share of mutants passed", width=4)
        colours = plots.coloured(self.policies)
        self._plot_kept(first, colours)
        for axes, curve in zip(every, CURVES[self.study], strict=True):
            for number, policy in enumerate(self.policies):
                aside = 0.012 * (number - (len(self.policies) - 1) / 2)  # so that intervals lie side by side
                points = [point for point in self.points if (point.policy, point.curve) == (policy, curve)]
                series = plots.Series(policy, [point.passed for point in points], colours[policy])
                plots.line(axes, [_middle(point, aside) for point in points], series)
            _scale(axes, curve)
        plots.save(figure, path)

    def _plot_kept(self, axes: Any, colours: Mapping[str, str]) -> None:
        tasks = list(dict.fromkeys(row.task for row in self.kept))
        by_place = {(row.policy, row.task): row for row in self.kept}
        rows = [[by_place.get((policy, task)) for task in tasks] for policy in self.policies]
        series = [
            plots.Series(policy, [kept.mutated if kept else None for kept in row], colours[policy])
            for policy, row in zip(self.policies, rows, strict=True)
        ]
        for xs, row in zip(plots.bars(axes, tasks, series), rows, strict=True):
            for x, kept in zip(xs, row, strict=True):
                if kept and kept.control.of:
                    axes.scatter(x, kept.control.share, **plots.MARK, label="control")


def _row(row: Kept) -> Row:
    both = row.control.of and row.mutated.of
    return {
        "task": row.task,
        "policy": row.policy,
        "Def.": row.default,
        "control": str(row.control),
        "Mut.": round(row.mean, 1) if row.mutated.of else None,
        "Mut./Def.": str(row.mutated),
        "net": points(row.mutated.share - row.control.share) if both else None,
        "invalid": row.invalid,
        "errors": row.errors,
    }


def _paper_row(row: published.Mutated) -> Row:
    def corrected(printed: object, right: object) -> str:
        shown = "–" if printed is None else str(printed)
        return shown if right is None else f"{shown} (adds up to {right})"

    right_kept = None if row.right_kept is None else percent(row.right_kept)
    return {
        "task": row.task,
        "policy": row.policy,
        "Def.": corrected(row.default, row.right_default),
        "Mut.": corrected(row.mutated, row.right_mutated),
        "Mut./Def.": corrected(percent(row.kept), right_kept),
    }


def _passed(point: Point | None) -> str:
    return f"{point.passed.count} of {point.passed.of}" if point else "–"


def _middle(point: Point, aside: float) -> float:
    """The middle of its bin, moved aside by a share of the axis."""
    if _logarithmic(point.curve):
        return math.sqrt(point.low * point.high) * 20**aside
    return (point.low + point.high) / 2 + aside * EDGES[point.curve][-1]


def _logarithmic(curve: str) -> bool:
    return curve in CURVES["rq3"]


def _scale(axes: Any, curve: str) -> None:
    ticks = EDGES[curve]
    labels = [str(tick) for tick in ticks]
    if _logarithmic(curve):
        axes.set_xscale("log", base=2)
        axes.minorticks_off()
        axes.set_xlabel("α")
        labels = [f"1/{tick}" if curve == "darker" and tick > 1 else str(tick) for tick in ticks]
    axes.set_xticks(ticks, labels)
    axes.set_xlim(ticks[0], ticks[-1])
