"""RQ3 and RQ4 on paper."""

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
    "Def.: scenes that the policy passed. Control: the same scenes once more, unmutated, in the seed "
    "of the mutants. Mut.: of Def., how many are passed with a mutant, the mean of three. The "
    "interval of Mut./Def. allows for it that mutants of one scene resemble each other. Net: "
    "Mut./Def. less the control's share, in points. Unfair mutants and errors count in no share.",
    BESIDE,
)
_DIFFERS = {
    "rq3": "it has no control arm, so that what a policy loses by chance counts as the light's; its light "
    "takes effect in pick-up only, as the other environments ignore it, and leaves ambient light as "
    "it is, here α multiplies every light in every task; it draws α by a coin, dark or bright, and "
    "then linearly, {alpha}: half of its 4302 draws are dark, and a quarter above 10.",
    "rq4": "it has no control arm; with the camera its background changes, too, a photo, which here stays as "
    "it is; it moves the camera by up to 5 cm along each of three axes (8.7 cm in all) and turns it "
    "about two axes, here it moves by at most 5 cm in any direction and turns by up to 5° about all "
    "three.",
}
_ALPHA = {
    "linear": "as here",
    "log": "here evenly in log2, so that small changes are as frequent as large ones",
}


@dataclass(frozen=True)
class MutationResult(StudyResult):
    """What RQ3 or RQ4 found.

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
            Table("Passed by default, and of these when mutated", [_row(each) for each in self.kept]),
            *(table for table in curves if table.rows),
            Table("The paper's, as far as known", [_paper_row(row) for row in self.published]),
        ]
        differs = _DIFFERS[self.study].format(alpha=_ALPHA[self.alpha or "linear"])
        return Sheet(self.title, tables, [*_NOTES, *self.gaps], differs, self._plot)

    def _curve(self, curve: str) -> list[Row]:
        its = {(each.policy, each.low, each.high): each for each in self.points if each.curve == curve}
        spans = sorted({(low, high) for _, low, high in its})
        return [
            {"policy": policy}
            | {f"{low:g} to {high:g}": _passed(its.get((policy, low, high))) for low, high in spans}
            for policy in dict.fromkeys(name for name, *_ in its)
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
                its = [each for each in self.points if (each.policy, each.curve) == (policy, curve)]
                series = plots.Series(policy, [each.passed for each in its], colours[policy])
                plots.line(axes, [_middle(each, aside) for each in its], series)
            _scale(axes, curve)
        plots.save(figure, path)

    def _plot_kept(self, axes: Any, colours: Mapping[str, str]) -> None:
        tasks = list(dict.fromkeys(each.task for each in self.kept))
        its = {(each.policy, each.task): each for each in self.kept}
        found = [[its.get((policy, task)) for task in tasks] for policy in self.policies]
        series = [
            plots.Series(policy, [each.mutated if each else None for each in row], colours[policy])
            for policy, row in zip(self.policies, found, strict=True)
        ]
        for stands, row in zip(plots.bars(axes, tasks, series), found, strict=True):
            its_controls = [(x, each.control) for x, each in zip(stands, row, strict=True) if each]
            marks = [(x, control.share) for x, control in its_controls if control.of]
            for x, y in marks:
                axes.scatter(x, y, **plots.MARK, label="control")


def _row(each: Kept) -> Row:
    both = each.control.of and each.mutated.of
    return {
        "task": each.task,
        "policy": each.policy,
        "Def.": each.default,
        "control": str(each.control),
        "Mut.": round(each.mean, 1) if each.mutated.of else None,
        "Mut./Def.": str(each.mutated),
        "net": points(each.mutated.share - each.control.share) if both else None,
        "invalid": each.invalid,
        "errors": each.errors,
    }


def _paper_row(row: published.Mutated) -> Row:
    def beside(value: object, right: object) -> str | None:
        shown = "–" if value is None else str(value)
        return shown if right is None else f"{shown} (adds up to {right})"

    return {
        "task": row.task,
        "policy": row.policy,
        "Def.": beside(row.default, row.right_default),
        "Mut.": beside(row.mutated, row.right_mutated),
        "Mut./Def.": beside(
            *(None if each is None else percent(each) for each in (row.kept, row.right_kept))
        ),
    }


def _passed(point: Point | None) -> str:
    return f"{point.passed.count} of {point.passed.of}" if point else "–"


def _middle(point: Point, aside: float) -> float:
    """Of its bin, moved aside by a share of the axis."""
    if _logarithmic(point.curve):
        return math.sqrt(point.low * point.high) * 20**aside
    return (point.low + point.high) / 2 + aside * EDGES[point.curve][-1]


def _logarithmic(curve: str) -> bool:
    return curve in CURVES["rq3"]


def _scale(axes: Any, curve: str) -> None:
    ticks = EDGES[curve]
    told = [str(each) for each in ticks]
    if _logarithmic(curve):
        axes.set_xscale("log", base=2)
        axes.minorticks_off()
        axes.set_xlabel("α")
        told = [f"1/{each}" if curve == "darker" and each > 1 else str(each) for each in ticks]
    axes.set_xticks(ticks, told)
    axes.set_xlim(ticks[0], ticks[-1])
