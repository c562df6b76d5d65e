#!/usr/bin/env python
"""Does `mini` get better at recovering if it is shown recoveries?

    scripts/recovery_mini.py OUT --gpus 1

The expert demonstrates scenes in which things slide or slip in mid-episode (EVENTS["moved"] of eval_mini.py), and
equally many scenes without events. The shipped weights are trained further with the former, or with the latter; half of
each batch are ones like those that they were first trained with. They, and the shipped ones, are judged in the same
fresh scenes: with events of the kinds that were shown, with events of other kinds, and without any.

OUT/figures.json says how many rollouts pass. What is in OUT already is not done again.
"""

from __future__ import annotations

import argparse
import json
import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from eval_mini import EVENTS
from repair.steps import SCRIPTS, call, old_demonstrations, once, train

from vlafuzz.policies.mini.policy import SHIPPED

ARMS = {"recoveries": ("--events", *EVENTS["moved"]), "plain": ()}
JUDGED = ("clutter", *EVENTS)
FIRST = 600_000  # number of the first demonstration, after those of the first training


def main() -> None:
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    parser.add_argument("out", type=Path, help="folder")
    parser.add_argument("--demos", type=int, default=400, help="of each arm and task")
    parser.add_argument("--repeats", type=int, default=2, help="trainings of each arm")
    parser.add_argument("--recipe", default="--rate 5e-4 --updates 1500 --batch 512", help="of train_mini.py")
    parser.add_argument("--scenes", type=int, default=200, help="of each task and kind, to be judged in")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--gpus", type=int, default=0)
    options = parser.parse_args()
    out = options.out
    old = old_demonstrations(out / "old", options.demos, options.workers)
    numbers = "--episodes", *[options.demos] * 4, "--workers", *[max(1, options.workers // 4)] * 4, "--first", FIRST
    for arm, flags in ARMS.items():
        with once(out / "demos" / arm) as unfinished:
            if unfinished:
                call(SCRIPTS / "make_demos.py", *numbers, *flags, "--out", unfinished)
    with ThreadPoolExecutor(2 * max(1, options.gpus)) as lanes:
        training = {
            f"{arm}-{number}": lanes.submit(
                train,
                out / "demos" / arm,
                old,
                SHIPPED,
                out / "mini" / f"{arm}-{number}",
                [*options.recipe.split(), "--seed", str(number)],
                number % options.gpus if options.gpus else None,
            )
            for number in range(options.repeats)
            for arm in ARMS
        }
        weights = {"shipped": SHIPPED} | {name: one.result() for name, one in training.items()}
    judged = {name: out / f"{name}.json" for name in weights}
    for name, path in judged.items():
        with once(path) as unfinished:
            if unfinished:
                some = "--scenes", options.scenes, "--workers", options.workers, "--sets", *JUDGED
                call(SCRIPTS / "eval_mini.py", "--weights", weights[name], *some, "--out", unfinished)
    figures = {name: json.loads(path.read_text(encoding="utf-8")) for name, path in judged.items()}
    (out / "figures.json").write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")
    for name, rows in figures.items():
        for kind in JUDGED:
            mine = [row for row in rows if row["set"] == kind]
            passed, judged_in = sum(row["passed"] for row in mine), sum(row["of"] for row in mine)
            print(f"{name:14}{kind:12}{passed:5} of {judged_in:5} = {passed / judged_in:6.1%}")


if __name__ == "__main__":
    main()
