"""Two examples of the commands that are used most, below the flags that `--help` shows."""

from __future__ import annotations

from collections.abc import Mapping

EXAMPLES: Mapping[str, tuple[str, str]] = {
    "run": (
        "vlafuzz run --policy pinhole --task put-on --budget 100 --store first.db",
        "vlafuzz run --policy openpi:ws://gpu:8000 --vary light,camera-position --time 1h",
    ),
    "triage": ("vlafuzz triage first.db --limit 5", "vlafuzz triage first.db --rollouts 500 --time 30m"),
    "report": ("vlafuzz report first.db --out page.html", "vlafuzz report mini-pick-up --out corpus.html --no-videos"),
    "regress": (
        "vlafuzz regress mini-pick-up --policy mini",
        "vlafuzz regress my-corpus --policy python:mine:make --baseline python:old:make --junit regress.xml",
    ),
    "export": (
        "vlafuzz export first.db --out failing.jsonl",
        "vlafuzz export first.db --format lerobot --demos 400 --hold-out 0.2 --out demos",
    ),
    "compare": (
        "vlafuzz compare --policy pinhole --budget 100 --repeats 7",
        "vlafuzz compare --strategies random,causes,nsga2 --policy pinhole --store compare.db --out compare",
    ),
    "replay": (
        "vlafuzz replay first.db --video failure.mp4",
        "vlafuzz replay failing.jsonl 3f2a --policy expert --video solved.mp4",
    ),
    "read": ("vlafuzz read outputs/eval/eval_info.json", "vlafuzz read new.csv --against old.csv --markdown"),
}


def epilog(command: str) -> str | None:
    """The examples of a command, a line each."""
    lines = ("Examples:", *EXAMPLES[command]) if command in EXAMPLES else ()
    return "\n\n".join(line.replace("[", r"\[") for line in lines) or None
