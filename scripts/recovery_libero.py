#!/usr/bin/env python
"""Does `mini-libero` get better at recovering if it is shown recoveries? As recovery_mini.py, in LIBERO.

    scripts/recovery_libero.py OUT --gpus 1

LIBERO's expert demonstrates scenes in which things slide or slip in mid-episode, and equally many scenes without
events. The shipped weights are trained further with the former, or with the latter; half of each batch are further
demonstrations without events. They, and the shipped ones, are judged in the same fresh fair scenes, with the same
seeds.

OUT/rollouts.json says what each rollout came to. What is in OUT already is not done again. Needs scripts/setup-libero.
"""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from make_libero_demos import ROBOT, SEEDS, drawn
from repair.steps import SCRIPTS, call, once, side_by_side, train

from vlafuzz.common.statistics import Share
from vlafuzz.model import Conditions, Verdict
from vlafuzz.policies.mini.policy import SHIPPED, Mini
from vlafuzz.worlds.libero.evaluator import LiberoEvaluator
from vlafuzz.worlds.libero.pictures import QUALITY
from vlafuzz.worlds.libero.space import LiberoSpace
from vlafuzz.worlds.tabletop.space import load_operators

TASKS = ("libero_object/0", "libero_object/4")
EVENTS = {
    "no event": (),
    "moved": ("target-slide", "goal-slide", "grip-slip"),
    "disturbed": ("target-knock", "camera-bump", "light-switch", "picture-loss", "control-stall", "grip-weak"),
}
ARMS = {"recoveries": EVENTS["moved"], "plain": ()}
FIRST = {"recoveries": 600_000, "plain": 600_000, "old": 500_000}  # numbers of demonstrations, none of them shown yet
JUDGED = 2 * SEEDS  # seed of the first scene: demonstrations are drawn with smaller ones
DRAWS = 4  # of a scene that is wanted, until one is fair


@dataclass(frozen=True)
class Judged:
    """One rollout."""

    weights: str
    task: str
    kind: str
    seed: int
    passed: bool


@dataclass(frozen=True)
class Judging:
    """Rollouts of some weights in scenes of one task and kind; those that are not fair are left out."""

    name: str
    weights: Path
    task: str
    kind: str
    scenes: int

    def run(self) -> list[Judged]:
        operators = load_operators(str(SCRIPTS / "demos-libero.yaml"))
        space = LiberoSpace(operators.only([*operators.varied, *EVENTS[self.kind]]), self.task, ROBOT)
        conditions = Conditions(task=self.task, robot=ROBOT, world={QUALITY.name: "fast"}, stop_early=True)
        evaluator = LiberoEvaluator(conditions, Mini(self.weights))
        rows: list[Judged] = []
        for seed in range(JUDGED, JUDGED + DRAWS * self.scenes):
            if len(rows) == self.scenes:
                break
            evaluator.seed = seed
            (outcome,) = evaluator.evaluate([drawn(space, seed, events=bool(EVENTS[self.kind]))])
            if outcome.verdict >= Verdict.PASSED:
                rows.append(Judged(self.name, self.task, self.kind, seed, outcome.verdict is Verdict.PASSED))
        evaluator.renew()
        return rows


def demonstrated(out: Path, name: str, events: Sequence[str], options: argparse.Namespace) -> Path:
    """A folder of the expert's demonstrations."""
    with once(out / "demos" / name) as unfinished:
        if unfinished:
            numbers = "--episodes", options.demos, "--batch", 30, "--workers", options.workers, "--first", FIRST[name]
            call(SCRIPTS / "make_libero_demos.py", *TASKS, *numbers, "--events", *events, "--out", unfinished)
    return out / "demos" / name


def main() -> None:
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    parser.add_argument("out", type=Path, help="folder")
    parser.add_argument("--demos", type=int, default=60, help="of each arm and task")
    parser.add_argument("--repeats", type=int, default=3, help="trainings of each arm")
    parser.add_argument("--recipe", default="--rate 2e-4 --updates 600 --batch 512", help="of train_mini.py")
    parser.add_argument("--scenes", type=int, default=20, help="of each task and kind, to be judged in")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--gpus", type=int, default=0)
    options = parser.parse_args()
    out, shipped = options.out, SHIPPED / "libero"
    old = demonstrated(out, "old", (), options)
    weights = {"shipped": shipped}
    for arm, events in ARMS.items():
        demos = demonstrated(out, arm, events, options)
        for number in range(options.repeats):
            recipe = [*options.recipe.split(), "--seed", str(number)]
            target, gpu = out / "mini" / f"{arm}-{number}", 0 if options.gpus else None
            weights[f"{arm}-{number}"] = train(demos, old, shipped, target, recipe, gpu, quantized=False)
    with once(out / "rollouts.json") as unfinished:
        if unfinished:
            jobs = [
                Judging(name, folder, task, kind, options.scenes)
                for kind in EVENTS
                for name, folder in weights.items()
                for task in TASKS
            ]
            rows = [asdict(row) for some in side_by_side(jobs, options.workers, "judged") for row in some]
            unfinished.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    rows = json.loads((out / "rollouts.json").read_text(encoding="utf-8"))
    for arm in ("shipped", *ARMS):
        for kind in EVENTS:
            passed = [row["passed"] for row in rows if row["weights"].startswith(arm) and row["kind"] == kind]
            print(f"{arm:12}{kind:12}{Share.of_counts(sum(passed), len(passed))}")


if __name__ == "__main__":
    main()
