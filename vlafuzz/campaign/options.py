# ruff: noqa: RUF009 - each call makes a field
"""RunConfig: a run as the user asks for it. Its options are declared here once, with what they mean.

The options of ``vlafuzz run``, the keys of ``--config`` and the arguments of ``vlafuzz.fuzz`` follow.
"""

from __future__ import annotations

import secrets
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from vlafuzz.errors import UsageError

# Groups of options on a page of help.
WHAT, SCENES, LONG, JUDGE, WHERE = "What to run", "Which scenes", "How long", "How to judge", "Where it runs"

AUTO = "auto"  # severity at which about one half fails
LEAST = 0.05  # severity: narrower ranges have a few levels only


def severity_of_flag(severity: float | str) -> float:
    """The factor that a user gives for ``--severity``; a UsageError if it is none."""
    try:
        number = float(severity)
    except ValueError:
        number = 0.0
    if not LEAST <= number <= 1:
        hint = "1 leaves the ranges as they are, 0.3 scales them to 30 %; auto finds where one half fails"
        raise UsageError(f"--severity {severity}: expected a number from {LEAST:g} to 1, or auto", hint=hint)
    return number


def _alone() -> str:
    from vlafuzz.model.conditions import ALONE  # which loads pydantic

    return ALONE + secrets.token_hex(4)


@dataclass(frozen=True)
class Option:
    """What users read about an option.

    Attributes:
        shown: the default in words.
        flag: its name on the command line; empty if only ``--config`` has it.
        kind: how the command line reads it, if not as the type of the field.
        of_run: what holds for ``vlafuzz run`` alone.
    """

    panel: str
    help: str
    shown: str
    flag: str
    kind: Any = None
    of_run: str = ""


def _option(panel: str, flag: str, text: str, shown: str = "", *, default: Any = None, **more: Any) -> Any:
    return field(default=default, metadata={"option": Option(panel, text, shown, flag, **more)})


@dataclass(frozen=True, kw_only=True)
class RunConfig:
    """A run as the user asks for it; None stands for a default.

    Attributes:
        alone: a label that no other configuration has, except for copies of this one. It is the label where the
            policy's name leaves open which model it is, so that the run shares no outcomes with others.
        packs: of objects, opened; they replace the built-in ones unless ``operators`` names those.
        command: what the user typed.
    """

    task: str | None = _option(
        WHAT,
        "--task",
        "What the robot is told to do.",
        "that of --scenes, or the first: `vlafuzz list worlds`",
        of_run="Several with commas, a suite, or all: one after another.",
    )
    robot: str | None = _option(
        WHAT,
        "",
        "What acts: `vlafuzz list worlds` names the robots; some need files from a --pack.",
        "that of --scenes, or the world's first",
    )
    policy: str | None = _option(
        WHAT,
        "--policy",
        "The policy under test, or python:pkg.mod:factory; `vlafuzz list policies` names some.",
        "the world's own",
    )
    label: str | None = _option(
        WHAT,
        "--label",
        "Which model the policy is: stored outcomes answer only under the same label.",
        "behind a server none, so that none answer",
    )
    strategy: str | None = _option(SCENES, "--strategy", "What proposes scenes, or python:pkg.mod:factory.", "causes")
    budget: int | None = _option(LONG, "--budget", "Policy rollouts, for each task.", "100; of a file once each scene")
    seed: int = _option(SCENES, "--seed", "The same seed gives the same scenes.", "0", default=0)
    operators: str | None = _option(
        SCENES, "--operators", "YAML file of ranges, or a shipped one's name.", "that of the robot"
    )
    vary: tuple[str, ...] = _option(
        SCENES, "--vary", "Only these operators vary: light,camera-position,…", default=(), kind=str
    )
    severity: float | str = _option(
        SCENES,
        "--severity",
        "Scale all ranges towards nominal by this factor; auto: so far that about one half fails.",
        "1: the ranges as they are",
        default=1.0,
        kind=str,
    )
    like: Path | None = _option(
        SCENES, "--like", "Test first what a store of an earlier version, or of another task, lists as causes."
    )
    scenes: Path | None = _option(WHAT, "--scenes", "Run every scene of this file once.")
    packs: tuple[Any, ...] = _option(
        WHAT,
        "--pack",
        "Objects and robots from this folder, laid out as SIMPLER and VLATest do; may be repeated.",
        default=(),
        kind=list[str],
    )
    store: Path | None = _option(
        WHERE, "--store", "The store; an existing one gets another run.", "runs/TASK-POLICY-SEED.db"
    )
    batch: int | None = _option(
        WHERE,
        "",
        "Proposals that are evaluated at a time.",
        "16; for causes a 115th of the budget, at least 4; for random 64",
    )
    repeats: int = _option(JUDGE, "", "Rollouts per scene; it fails if one of them fails.", "1", default=1)
    stop_early: bool = _option(JUDGE, "", "End a rollout at its first success.", "false", default=False)
    quality: str | None = _option(
        JUDGE, "", "How a world draws, if it has a choice: full; fast, cheaper.", "full for servers, else the world's"
    )
    workers: int | None = _option(
        WHERE,
        "--workers",
        "Processes that evaluate scenes.",
        "as many as there are cores and memory for; 1 for a policy of your own",
    )
    executor: str | None = _option(
        WHERE,
        "--executor",
        "Where scenes are evaluated: local, processes, ray, or ray:auto or ray:HOST:PORT for a cluster.",
        "local; processes for several",
    )
    alone: str = field(default_factory=_alone, compare=False)
    command: str = ""


OPTIONS: dict[str, Option] = {one.name: one.metadata["option"] for one in fields(RunConfig) if "option" in one.metadata}
OF_WORLDS = ("quality",)  # options that some worlds have: see ``World.settings``
