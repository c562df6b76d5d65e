"""What `--help` adds to the flags: the panel of each, and two examples of the commands that are used most."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from vlafuzz.campaign.options import JUDGE, LONG, MORE, OPTIONS, OUTPUT, SCENES, WHAT, WHERE

# Groups of the options that no ``RunConfig`` declares.
PANELS: Mapping[str, tuple[str, ...]] = {
    WHAT: (
        *("version", "baseline", "policy_a", "policy_b", "label_a", "label_b", "checkpoints", "against"),
        *("column", "world", "first_failure", "pack", "unseen", "stores", "config"),
    ),
    SCENES: (*("strategies", "lab study.alpha", "verdict", "run", "export.scenes"), *("hold_out", "run_a", "run_b")),
    LONG: (
        *("time", "rollouts", "triage_rollouts", "max_rollouts", "limit", "comparisons"),
        *("demos", "demos_per_scene", "n"),
    ),
    JUDGE: (
        *("alpha", "nights", "error", "whole", "firm", "static", "frame", "min_distance", "thorough"),
        *("states", "pictures"),
    ),
    MORE: ("resume", "certify", "unchecked", "trust", "answers", "controls", "minimal"),
    WHERE: (),
    OUTPUT: (
        *("out", "follow", "format_", "json", "csv", "markdown", "junit", "summary", "sarif"),
        *("fail_on_finding", "video", "videos", "picture", "seen", "trace", "film", "verbose"),
    ),
}

EXAMPLES: Mapping[str, tuple[str, str]] = {
    "run": (
        "vlafuzz run --policy pinhole --task put-on --budget 100 --store first.db",
        "vlafuzz run --policy 'openpi:ws://gpu:8000?profile=libero' --vary light,camera-position --time 1h",
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
        "vlafuzz replay failing.jsonl 3f2a --policy expert --picture solved.png",
    ),
    "read": (
        "vlafuzz read outputs/eval/eval_info.json --out page.html",
        "vlafuzz read new.csv --against old.csv --junit read.xml",
    ),
    "bisect": (
        "vlafuzz bisect my-corpus --policy lerobot:{} --checkpoints out/010000 out/020000 out/030000",
        "vlafuzz bisect my-corpus --checkpoints http://gpu:8001/act http://gpu:8002/act http://gpu:8003/act",
    ),
}

MANY = 6  # more options than these are shown in panels
_PANEL_OF = {name: told.panel for name, told in OPTIONS.items()} | {
    name: panel for panel, names in PANELS.items() for name in names
}


def epilog(command: str) -> str | None:
    """The examples of a command, a line each."""
    lines = ("Examples:", *EXAMPLES[command]) if command in EXAMPLES else ()
    return "\n\n".join(line.replace("[", r"\[") for line in lines) or None


def grouped(command: Any) -> Any:
    """The same command with its options in panels, unless it has few."""
    options = [param for param in command.params if param.param_type_name == "option"]
    if len(options) > MANY:
        for option in options:
            special = _PANEL_OF.get(f"{command.name}.{option.name}")
            option.rich_help_panel = special or _PANEL_OF.get(option.name)
        order = [None, *PANELS]  # arguments have none
        command.params.sort(key=lambda param: order.index(getattr(param, "rich_help_panel", None)))
    return command
