#!/usr/bin/env python
"""Repair `mini`: fuzz it, let the expert demonstrate, train it further, and say what is better and worse.

    scripts/repair_mini.py OUT                                     # two rounds with failing scenes
    scripts/repair_mini.py OUT --arms random failed --repeats 3    # which demonstrations help?

Random scenes are rolled out, the expert demonstrates those of each arm (repair/arms.py), and the shipped weights are
trained further with equally many demonstrations in each arm; half of each batch are ones like those that they were
first trained with. The arms of --again go through a second round with what their own weights fail in. All are judged in
the same scenes, which nobody was trained with. With --causes, the first arm is fuzzed and triaged once more, and its
causes are compared with those before.

OUT/page.html says what came out; OUT/mini/ARM-N has the weights. What is in OUT already is not done again. Training
wants a GPU; --gpus says how many there are.
"""

from __future__ import annotations

import argparse
import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from repair.arms import ARMS
from repair.changes import changes
from repair.page import page
from repair.steps import old_demonstrations
from repair.study import Study

from vlafuzz.policies.mini.policy import SHIPPED
from vlafuzz.worlds.tabletop.tasks import TASKS


def main() -> None:
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    parser.add_argument("out", type=Path, help="folder")
    parser.add_argument("--tasks", nargs="+", default=["pick-up", "move-near"], choices=list(TASKS))
    parser.add_argument("--arms", nargs="+", default=["failed"], choices=list(ARMS))
    parser.add_argument("--again", nargs="*", choices=list(ARMS), help="arms with a second round [all]")
    parser.add_argument("--repeats", type=int, default=1)
    parser.add_argument("--budget", type=int, default=1000, help="rollouts of each task's run")
    parser.add_argument("--demos", type=int, default=400, help="demonstrations of each task")
    parser.add_argument("--old-demos", type=int, default=800, help="of each task, to be replayed")
    parser.add_argument("--recipe", default="--rate 5e-4 --updates 1500 --batch 512", help="of train_mini.py")
    parser.add_argument("--seed", type=int, default=800, help="of the first repetition: its runs and trainings")
    parser.add_argument("--first", type=int, default=700_000, help="number of the first scene to be judged in")
    parser.add_argument("--scenes", type=int, default=1000, help="random ones of each task, to be judged in")
    parser.add_argument("--nominal", type=int, default=200, help="nominal ones of each task")
    parser.add_argument("--causes", help="time to triage each run of the first arm, such as 10m")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--gpus", type=int, default=0)
    options = parser.parse_args()
    options.again = options.arms if options.again is None else options.again
    old_demonstrations(options.out / "old", options.old_demos, options.workers)
    with ThreadPoolExecutor(2 * max(1, options.gpus)) as lanes:
        study = Study(options, lanes)
        first = study.first()
        study.judge({"shipped": lanes.submit(lambda: SHIPPED), **first})
        trained = {name: one.result() for name, one in first.items()}
        second = study.second(trained)
        study.judge(second)
        trained |= {name: one.result() for name, one in second.items()}
    arm = options.arms[0]
    last = f"{arm}-again-0" if arm in options.again else f"{arm}-0"
    rows = changes(study, last, trained[last]) if options.causes else []
    (options.out / "page.html").write_text(page(options.out, options.tasks, last, rows), encoding="utf-8")
    print(f"wrote {options.out / 'page.html'}")


if __name__ == "__main__":
    main()
