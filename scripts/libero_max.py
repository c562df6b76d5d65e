"""LIBERO-MAX's question: how often does a policy still succeed when something changes in mid-episode?

Pairs of rollouts in LIBERO's object suite, from the same initial state and with the same seed: one without and one with
a change. Kinds and severities are LIBERO-MAX's; operators/libero-max.yaml says which of them vlafuzz does not have.
Needs scripts/setup-libero; runs for minutes.

    python scripts/libero_max.py --out pairs.json
    python scripts/libero_max.py --policy libero-expert --out expert.json
"""

from __future__ import annotations

import argparse
import json
import math
import multiprocessing
import os
import sys
import time
from collections.abc import Iterator
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from vlafuzz.common.files import write_whole
from vlafuzz.common.statistics import Share
from vlafuzz.errors import SimulatorError
from vlafuzz.model import Conditions, Light, Outcome, Scene
from vlafuzz.model.scene import CameraBump, LightSwitch, Moment, Slide
from vlafuzz.rollouts.setup import make_evaluator
from vlafuzz.worlds.evaluator import SceneEvaluator
from vlafuzz.worlds.libero.space import nominal_scene

TASKS = [f"libero_object/{number}" for number in range(10)]
AT: Moment = "approach"
FACTORS = (0.55, 0.3)
DIM = 0.3  # of the light at the start, in both rollouts of a pair whose light goes up to the usual one
TURNS = (5.0, -10.0, 15.0)  # degrees; the other way where things of the task would leave the picture
VERTICAL = np.array([-0.529, 0.0, 0.849])  # by the camera's axes (forward, left, up): it looks down by 32°
DISTANCES = (0.06, 0.12)  # metres
DIRECTIONS = range(-180, 180, 15)  # degrees


@dataclass(frozen=True)
class Pair:
    """Whether two rollouts succeed; ``lost``: the stage that fails. ``changed`` is None where no change is fair."""

    task: str
    state: int
    kind: str
    severity: str
    events: dict[str, dict[str, Any]]
    control: bool
    changed: bool | None
    lost: str | None


def changes(usual: Scene) -> Iterator[tuple[str, str, list[Scene]]]:
    """Kind and severity of each change of a scene, and scenes with it, of which the first fair one counts."""
    for factor in FACTORS:
        yield "light", f"× {factor:g}", [replace(usual, light_switch=LightSwitch(AT, factor))]
    yield "light", f"× {DIM:g} to × 1", [replace(usual, light=Light(DIM), light_switch=LightSwitch(AT, 1 / DIM))]
    for turn in TURNS:
        yield "camera", f"{abs(turn):g}°", [replace(usual, camera_bump=bump(way)) for way in (turn, -turn)]
    for kind, part in (("target", "target_slide"), ("goal", "goal_slide")):
        rng = np.random.default_rng([usual.start.state, *f"{usual.task} {part}".encode()])
        directions = rng.permutation(DIRECTIONS).tolist()
        for distance in DISTANCES:
            slides: list[dict[str, Any]] = [{part: Slide(AT, distance, float(way))} for way in directions]
            yield kind, f"{100 * distance:g} cm", [replace(usual, **slide) for slide in slides]


def bump(turn: float) -> CameraBump:
    """The camera turned in its place about the vertical of the room, by degrees."""
    yaw, pitch, roll = Rotation.from_rotvec(math.radians(turn) * VERTICAL).as_euler("ZYX", degrees=True).tolist()
    return CameraBump(AT, roll, pitch, yaw)


def pairs(task: str, *, policy: str, states: int, quality: str) -> list[Pair]:
    """All pairs of a task."""
    os.environ.update({"OMP_NUM_THREADS": "1", "LP_NUM_THREADS": "0"})
    began, found = time.monotonic(), list[Pair]()
    conditions = Conditions(task=task, robot="libero", policy=policy, world={"quality": quality}, stop_early=True)
    with closing(make_evaluator(conditions)) as evaluator:
        for state in range(states):
            evaluator.seed = state
            usual = nominal_scene(task, "libero", state)
            controls = {one.light: ended(evaluator, one) for one in (usual, replace(usual, light=Light(DIM)))}
            for kind, severity, scenes in changes(usual):
                fair = next((scene for scene in scenes if evaluator.check(scene) is None), None)
                changed = None if fair is None else ended(evaluator, fair)
                events = {name: asdict(event) for name, event in (fair or scenes[0]).events.items()}
                after = (changed.passed, changed.lost_stage) if changed else (None, None)
                found.append(Pair(task, state, kind, severity, events, controls[scenes[0].light].passed, *after))
    print(f"{task}: {len(found)} pairs in {time.monotonic() - began:.0f} s", file=sys.stderr, flush=True)
    return found


def ended(evaluator: SceneEvaluator, scene: Scene) -> Outcome:
    """How the policy ends in a fair scene; a SimulatorError if it could not be rolled out."""
    (outcome,) = evaluator.evaluate([scene])
    if not outcome.judged:
        raise SimulatorError(f"{scene.task}, initial state {scene.start.state}: {outcome.detail}")
    return outcome


def table(found: list[Pair]) -> str:
    """What is known of each kind and severity, in Markdown."""
    groups = dict[tuple[str, str], list[Pair]]()
    for pair in found:
        groups.setdefault((pair.kind, pair.severity), []).append(pair)
    rows = []
    for (kind, severity), group in groups.items():
        fair = [pair for pair in group if pair.changed is not None]
        about = {"kind": kind, "severity": severity, "pairs": len(fair), "unfair": len(group) - len(fair)}
        ends = {"without": [pair.control for pair in fair], "with": [bool(pair.changed) for pair in fair]}
        rows.append(about | {arm: Share.of_counts(sum(passed), len(passed)) for arm, passed in ends.items()})
    lines = [list(rows[0]), ["---"] * len(rows[0]), *(list(map(str, row.values())) for row in rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--policy", default="mini-libero", help="any that acts in LIBERO")
    parser.add_argument("--tasks", nargs="+", default=TASKS, help="SUITE/NUMBER")
    parser.add_argument("--states", type=int, default=3, help="the first initial states of each task")
    parser.add_argument("--quality", default="fast", choices=("full", "fast"), help="of pictures")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, required=True, help="JSON with every pair")
    options = parser.parse_args()
    about = {name: getattr(options, name) for name in ("policy", "states", "quality")}
    with multiprocessing.get_context("spawn").Pool(options.workers, maxtasksperchild=1) as pool:
        found = [pair for of_task in pool.imap(partial(pairs, **about), options.tasks) for pair in of_task]
    write_whole(options.out, json.dumps(about | {"pairs": [asdict(pair) for pair in found]}, indent=1) + "\n")
    print(table(found))


if __name__ == "__main__":
    main()
