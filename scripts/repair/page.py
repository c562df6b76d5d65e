"""The page of a repair: figures before and after, by cause, and strips of scenes that end otherwise now."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from eval_mini import draw
from numpy.typing import NDArray
from PIL import Image

from repair import figures, judged
from repair.figures import SHIPPED, Estimate, Row
from repair.sheet import Picture, Sheet, render_sheet
from vlafuzz.common.text import interval, percent, points
from vlafuzz.model import Scene
from vlafuzz.policies.mini.policy import SHIPPED as WEIGHTS
from vlafuzz.report.tables import Table
from vlafuzz.worlds.recording import Recording

STRIPS, FRAMES = 3, 6  # scenes of each way to end, and frames of a rollout
WAYS = {
    (True, False): "Failed before, passes now",
    (True, True): "Fails as before",
    (False, True): "Passed before, fails now",
}


def page(folder: Path, tasks: Sequence[str], policy: str, causes: Sequence[Mapping[str, str]]) -> str:
    """The page as HTML.

    Args:
        folder: of the repair.
        policy: name of the one whose rollouts are shown, such as ``failed-0``.
        causes: rows of a table that compares it with the shipped policy.
    """
    rows = figures.rows(folder, tasks)
    pictures = [
        Picture("Failures in random scenes", plot(rows), "The table has the numbers."),
        *strips(folder, tasks, policy),
    ]
    changed = [Table(f"Causes: shipped, then {policy}", causes)] if causes else []
    return render_sheet(
        Sheet(
            title="mini, repaired",
            source=str(folder),
            headline="The shipped weights, trained further with demonstrations of the expert.",
            conclusions=tuple(sentence(row) for row in rows if row.arm != SHIPPED),
            pictures=tuple(pictures),
            tables=(table(rows), *changed),
        )
    )


def sentence(row: Row) -> str:
    """What an arm came to."""
    return (
        f"{row.arm}: fails in {_share(row.failures['all'])} of random scenes, {_points(row.fewer)} points "
        f"fewer than before; {_points(row.lost)} points more in nominal ones."
    )


def table(rows: Sequence[Row]) -> Table:
    """The figures of all arms."""
    shown = [
        {"arm": row.arm, "repetitions": str(row.repeats)}
        | {f"failures, {task}": _share(estimate) for task, estimate in row.failures.items()}
        | {"points fewer than random": _points(row.fewer_than_random) if row.fewer_than_random else "–"}
        | {"nominal failures": _share(row.nominal), "points more": _points(row.lost)}
        for row in rows
    ]
    return Table("Before and after", shown, "Shares with 95 % intervals (bootstrap over scenes and repetitions).")


def _share(estimate: Estimate) -> str:
    return f"{percent(estimate[0])} ({interval(*estimate[1:])})"


def _points(estimate: Estimate) -> str:
    value, low, high = map(points, estimate)
    return f"{value} ({low} to {high})"


def plot(rows: Sequence[Row]) -> bytes:
    """Failure shares of all arms by task, as PNG."""
    from matplotlib.figure import Figure

    tasks = list(rows[0].failures)
    figure = Figure(figsize=(4 * len(tasks), 0.5 * len(rows) + 1.2), layout="constrained")
    panels = figure.subplots(1, len(tasks), sharey=True, squeeze=False)[0]
    for axes, task in zip(panels, tasks, strict=True):
        for place, row in enumerate(rows):
            value, low, high = (100 * number for number in row.failures[task])
            colour = "#000000" if row.arm == SHIPPED else "#0072B2"
            axes.errorbar(value, -place, xerr=[[value - low], [high - value]], fmt="o", color=colour, capsize=3)
        axes.axvline(100 * rows[0].failures[task][0], color="#999999", linewidth=0.8, linestyle=":")
        axes.set(title=f"{task}: failures, %", xlim=(0, None))
        axes.spines[["top", "right"]].set_visible(False)
    panels[0].set_yticks([-place for place in range(len(rows))], [row.arm for row in rows])
    content = io.BytesIO()
    figure.savefig(content, dpi=130, format="png")
    return content.getvalue()


def strips(folder: Path, tasks: Sequence[str], policy: str) -> Iterator[Picture]:
    """Rollouts of a few judged scenes of each way to end: above the shipped policy, below the other one.

    Scenes that end otherwise on this machine than where they were judged are left out.
    """
    weights = {SHIPPED: WEIGHTS, policy: folder / "mini" / policy}
    before, after = (figures.scenes_of(folder / "judged" / name) for name in weights)
    for task in tasks:
        first, second = before["random", task], after["random", task]
        for way, title in WAYS.items():
            ending = [number for number in sorted(first) if (first[number], second[number]) == way]
            for number in ending[:STRIPS]:
                scene = draw(task, "random", number)
                rolled = [_frames(path, task, scene) for path in weights.values()]
                if tuple(failed for failed, _ in rolled) == way:
                    strip = _png(np.concatenate([frames for _, frames in rolled]))
                    yield Picture(f"{title}: {scene.instruction}", strip, f"{task}, scene {number}")


def _frames(weights: Path, task: str, scene: Scene) -> tuple[bool, NDArray[np.uint8]]:
    """Whether the policy fails, and a few frames side by side."""
    recording = Recording(160)
    failed = judged.roll(weights, task, scene, recording)
    chosen = np.linspace(0, len(recording.frames) - 1, FRAMES).round().astype(int)
    return failed, np.concatenate([recording.frames[index] for index in chosen], axis=1)


def _png(picture: NDArray[np.uint8]) -> bytes:
    content = io.BytesIO()
    Image.fromarray(picture).save(content, "PNG")
    return content.getvalue()
