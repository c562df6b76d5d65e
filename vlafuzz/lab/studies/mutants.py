"""RQ3 and RQ4: how many of the scenes that a policy passed it still passes under other light or camera."""

import math
from bisect import bisect
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np

from vlafuzz.common.statistics import Share
from vlafuzz.common.text import Row, percent, points
from vlafuzz.errors import UsageError
from vlafuzz.lab.plots import coloured, save
from vlafuzz.lab.studies import published
from vlafuzz.lab.studies.runner import Tried, Variant
from vlafuzz.lab.studies.sheet import BESIDE, MARK, Series, StudyResult, bars, line, share_panels
from vlafuzz.model.outcome import Verdict
from vlafuzz.model.scene import Scene
from vlafuzz.report.view import Table
from vlafuzz.worlds.manipulation.operators import CameraOrientation, CameraPosition, Light
from vlafuzz.worlds.tabletop.space import OperatorSet, SearchSpace

Alpha = Literal["linear", "log"]
MUTANTS = 3  # per scene, as in the paper
CONTROL, MUTANT, ALL = "control", "mutant", "all"
MUTATED = {"rq3": (Light.name,), "rq4": (CameraPosition.name, CameraOrientation.name)}
_REDRAWS = 100
EDGES = {  # of the bins of a curve; values beyond the last edge belong to the last bin
    "darker": (1, 2, 4, 8, 20),
    "brighter": (1, 2, 4, 8, 20),
    "camera moved, cm": (0, 1, 2, 3, 4, 5),
    "camera turned, degrees": (0, 2, 4, 6, 9),
}
CURVES = {"rq3": ("darker", "brighter"), "rq4": ("camera moved, cm", "camera turned, degrees")}


@dataclass(frozen=True, kw_only=True)
class Kept:
    """How many scenes of a task a policy still passes when they are mutated, of those that it had passed.

    Attributes:
        task: ``all`` for all tasks together.
        default: scenes that it had passed.
        control: the share of these passed again, unmutated, with the seed of the mutants.
        mutated: the share of their mutants passed.
        invalid, errors: mutants and controls, left out of both shares.
    """

    task: str
    policy: str
    default: int
    control: Share
    mutated: Share
    invalid: int
    errors: int

    @property
    def mean(self) -> float:
        """The paper's Mut.: how many of the scenes are passed when each is mutated, on average."""
        return self.mutated.share * self.default


@dataclass(frozen=True)
class Point:
    """The share passed of the mutants of all tasks that are off nominal by ``low`` to ``high``."""

    policy: str
    curve: str
    low: float
    high: float
    passed: Share


def mutating(study: str, operators: OperatorSet, alpha: Alpha) -> OperatorSet:
    """The operators, of which only the study's vary: light as drawn in the paper, or evenly in log2."""
    light = operators.get(Light).model_copy(update={"spread": "coin" if alpha == "linear" else "even"})
    return replace(operators, operators={**operators.operators, Light.name: light}).only(MUTATED[study])


def mutants(space: SearchSpace, scenes: Sequence[Scene], seed: int) -> list[Variant]:
    """Each scene unmutated, then ``MUTANTS`` distinct mutants of it, in which the space's operators vary.

    Raises:
        UsageError: the ranges leave no room for so many.
    """
    variants: list[Variant] = []
    for origin, scene in enumerate(scenes):
        rng = np.random.default_rng([seed, int(scene.digest, 16)])  # a scene's mutants suit all policies
        variants.append(Variant(scene, origin, CONTROL))
        variants += [Variant(mutant, origin, MUTANT) for mutant in _draws(space, scene, rng)]
    return variants


def kept(task: str, policy: str, tried: Sequence[Tried]) -> Kept:
    """Count the outcomes of scenes that a policy had passed, and of their mutants."""
    verdicts, controls = [result.outcome.verdict for result in tried], _judged(tried, CONTROL)
    return Kept(
        task=task,
        policy=policy,
        default=sum(result.variant.arm == CONTROL for result in tried),
        control=Share.of_counts(sum(result.passed for result in controls), len(controls)),
        mutated=_share(_judged(tried, MUTANT)),
        invalid=verdicts.count(Verdict.INVALID),
        errors=verdicts.count(Verdict.ERROR),
    )


def curve_points(study: str, policy: str, tried: Sequence[Tried]) -> list[Point]:
    """The curves of a study: the share of mutants passed, by their distance from nominal."""
    drawn: list[Point] = []
    for curve in CURVES[study]:
        edges = EDGES[curve]
        bins: list[list[Tried]] = [[] for _ in edges[1:]]
        for result in _judged(tried, MUTANT):
            if (distance := _distance(curve, result.variant.scene)) is not None:
                bins[bisect(edges[1:-1], distance)].append(result)
        spans = zip(pairwise(edges), bins, strict=True)
        drawn += [Point(policy, curve, *span, _share(inside)) for span, inside in spans if inside]
    return drawn


def _draws(space: SearchSpace, scene: Scene, rng: np.random.Generator) -> list[Scene]:
    values, drawn = space.values(scene), {scene: None}
    for _ in range(_REDRAWS):
        changed = values | {gene.path: gene.draw(rng) for gene in space.genes}
        drawn[space.composer.compose(changed)] = None
        if len(drawn) > MUTANTS:
            return list(drawn)[1:]
    names = ", ".join(sorted(space.operators.varied))
    raise UsageError(f"{names}: the ranges hold no {MUTANTS} mutants of a scene", hint="widen them")


def _judged(tried: Sequence[Tried], arm: str) -> list[Tried]:
    return [result for result in tried if result.variant.arm == arm and result.judged]


def _share(mutants: Sequence[Tried]) -> Share:
    return Share.grouped([(result.variant.origin, result.passed) for result in mutants])


def _distance(curve: str, scene: Scene) -> float | None:
    """The distance of a mutant from nominal along a curve; None where it is on the other side."""
    light, camera = scene.light.intensity, scene.camera
    if curve == "darker":
        return 1 / light if light < 1 else None
    if curve == "brighter":
        return light if light > 1 else None
    if curve.startswith("camera moved"):
        return 100 * camera.distance
    return math.hypot(camera.roll, camera.pitch, camera.yaw)


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
_ALPHA = {"linear": "as here", "log": "here evenly in log2, so that small changes are as frequent as large ones"}


@dataclass(frozen=True)
class MutationResult(StudyResult):
    """The result of RQ3 or RQ4, which has no alpha, beside the known rows of the paper's table."""

    alpha: Alpha | None
    kept: list[Kept]
    points: list[Point]
    published: list[published.Mutated]

    def sheet(self) -> tuple[list[Table], list[str]]:
        """The paper's table, and curves."""
        curves = [Table(f"Mutants passed: {curve}", self._curve(curve)) for curve in CURVES[self.study]]
        tables = [
            Table("Passed by default, and of these when mutated", [_row(row) for row in self.kept]),
            *(table for table in curves if table.rows),
            Table("The paper's, as far as known", [_paper_row(row) for row in self.published]),
        ]
        differs = _DIFFERS[self.study].format(alpha=_ALPHA[self.alpha or "linear"])
        return tables, self.noted(differs, *_NOTES)

    def _curve(self, curve: str) -> list[Row]:
        rows: dict[str, Row] = {}
        drawn = [point for point in self.points if point.curve == curve]
        spans = sorted({(point.low, point.high) for point in drawn})
        for point in drawn:
            row = rows.setdefault(
                point.policy, {"policy": point.policy} | {f"{low:g} to {high:g}": "–" for low, high in spans}
            )
            row[f"{point.low:g} to {point.high:g}"] = f"{point.passed.count} of {point.passed.of}"
        return list(rows.values())

    def draw(self, path: Path) -> None:
        """What is kept of each task beside the control; then the curves."""
        curves = CURVES[self.study]
        figure, (first, *every) = share_panels(self.title, ["tasks", *curves], "share of mutants passed", width=4)
        colours = coloured(self.policies)
        self._plot_kept(first, colours)
        for axes, curve in zip(every, curves, strict=True):
            for number, policy in enumerate(self.policies):
                aside = 0.012 * (number - (len(self.policies) - 1) / 2)  # so that intervals lie side by side
                points = [point for point in self.points if (point.policy, point.curve) == (policy, curve)]
                series = Series(policy, [point.passed for point in points], colours[policy])
                line(axes, [_middle(point, aside) for point in points], series)
            _scale(axes, curve)
        save(figure, path)

    def _plot_kept(self, axes: Any, colours: Mapping[str, str]) -> None:
        tasks = list(dict.fromkeys(row.task for row in self.kept))
        by_place = {(row.policy, row.task): row for row in self.kept}
        rows = {policy: [by_place.get((policy, task)) for task in tasks] for policy in self.policies}
        series = [
            Series(policy, [kept.mutated if kept else None for kept in row], colours[policy])
            for policy, row in rows.items()
        ]
        for xs, row in zip(bars(axes, tasks, series), rows.values(), strict=True):
            for x, kept in zip(xs, row, strict=True):
                if kept and kept.control.of:
                    axes.scatter(x, kept.control.share, **MARK, label="control")


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


def _middle(point: Point, aside: float) -> float:
    """The middle of its bin, moved aside by a share of the axis."""
    if point.curve in CURVES["rq3"]:
        return math.sqrt(point.low * point.high) * 20**aside
    return (point.low + point.high) / 2 + aside * EDGES[point.curve][-1]


def _scale(axes: Any, curve: str) -> None:
    ticks = EDGES[curve]
    labels = [str(tick) for tick in ticks]
    if curve in CURVES["rq3"]:
        axes.set_xscale("log", base=2)
        axes.minorticks_off()
        axes.set_xlabel("α")
        labels = [f"1/{tick}" if curve == "darker" and tick > 1 else str(tick) for tick in ticks]
    axes.set_xticks(ticks, labels)
    axes.set_xlim(ticks[0], ticks[-1])
