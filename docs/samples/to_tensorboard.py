"""Logs the runs of a store to TensorBoard."""

from torch.utils.tensorboard import SummaryWriter

import vlafuzz

store = vlafuzz.open_store("pinhole.db")
for run in store.runs():
    board = SummaryWriter(f"boards/{run.task}-{run.label or run.run}")
    failed = judged = 0
    for trial in store.trials(run.run):
        board.add_scalar("progress", trial.progress, trial.proposal)
        if trial.random and trial.verdict in ("passed", "failed"):
            failed, judged = failed + (trial.verdict == "failed"), judged + 1
            board.add_scalar("failure rate of random scenes", failed / judged, trial.proposal)
    for cause in store.causes(run.run):
        board.add_text("causes", "; ".join(cause.conditions))
    board.close()
