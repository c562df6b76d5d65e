"""Logs the runs of a store to Weights & Biases."""

from dataclasses import asdict

import wandb

import vlafuzz

store = vlafuzz.open_store("pinhole.db")
for run in store.runs():
    board = wandb.init(project="vlafuzz", group=run.task, name=run.label or run.policy, config=asdict(run))
    failed = judged = 0
    for trial in store.trials(run.run):
        values = {f"values/{name}": value for name, value in trial.values.items()}
        row = {"failed": trial.verdict == "failed", "progress": trial.progress, **values}
        if trial.random and trial.verdict in ("passed", "failed"):
            failed, judged = failed + row["failed"], judged + 1
            row["failure rate of random scenes"] = failed / judged
        board.log(row, step=trial.proposal)
    board.summary["causes"] = [cause.conditions for cause in store.causes(run.run)]
    board.finish()
