"""RunConfig: a run as the user asks for it. Its options are declared here once, with what they mean.

The options of ``vlafuzz run``, the keys of ``--config`` and the arguments of ``vlafuzz.fuzz`` follow.
"""

from __future__ import annotations

import secrets
from dataclasses import KW_ONLY, dataclass, field
from pathlib import Path
from typing import Annotated, Any, get_args, get_type_hints

from vlafuzz.model.conditions import ALONE

# Groups of options, in the order in which a help page shows them.
WHAT, SCENES, LONG = "What to run", "Which scenes", "How long"
JUDGE, MORE, WHERE, OUTPUT = "How to judge", "What else to do", "Where it runs", "Output"


@dataclass(frozen=True)
class Option:
    """What users read about an option.

    Attributes:
        default: in words, where None stands for it.
        flag: its name on the command line; empty if only ``--config`` has it.
        kind: how the command line reads it, if not as the type of the field.
    """

    panel: str
    help: str
    _: KW_ONLY
    flag: str = ""
    default: str = ""
    kind: Any = None


@dataclass(frozen=True, kw_only=True)
class RunConfig:
    """A run as the user asks for it; None stands for a default.

    Attributes:
        alone: a label that no other configuration has, except for copies of this one. It is the label where
            the policy's name leaves open which model it is, so that the run shares no outcomes with others.
        packs: of objects, opened; they replace the built-in ones unless ``operators`` names those.
        command: what the user typed.
    """

    task: Annotated[
        str | None,
        Option(
            WHAT,
            "What the robot is told to do; several with commas, or all: one after another.",
            flag="--task",
            default="that of --scenes, or the first: `vlafuzz list worlds`",
        ),
    ] = None
    robot: Annotated[
        str | None,
        Option(
            WHAT,
            "What acts: `vlafuzz list worlds` names the robots; some need files from a --pack.",
            flag="--robot",
            default="that of --scenes, or the world's first",
        ),
    ] = None
    policy: Annotated[
        str | None,
        Option(
            WHAT,
            "The policy under test, or python:pkg.mod:factory; `vlafuzz list policies` names some.",
            flag="--policy",
            default="the world's own",
        ),
    ] = None
    label: Annotated[
        str | None,
        Option(
            WHAT,
            "Which model the policy is: stored outcomes answer only under the same label.",
            flag="--label",
            default="behind a server none, so that none answer",
        ),
    ] = None
    strategy: Annotated[
        str | None,
        Option(
            SCENES,
            "What proposes scenes, or python:pkg.mod:factory.",
            flag="--strategy",
            default="causes; with a pool surrogate",
        ),
    ] = None
    budget: Annotated[
        int | None,
        Option(
            LONG, "Policy rollouts, for each task.", flag="--budget", default="100; of a file once each scene"
        ),
    ] = None
    seed: Annotated[
        int, Option(SCENES, "The same seed gives the same scenes.", flag="--seed", default="0")
    ] = 0
    operators: Annotated[
        str | None,
        Option(
            SCENES,
            "YAML file of ranges, or a shipped one's name.",
            flag="--operators",
            default="that of the robot",
        ),
    ] = None
    vary: Annotated[
        tuple[str, ...],
        Option(SCENES, "Only these operators vary: light,camera-position,…", flag="--vary", kind=str),
    ] = ()
    scenes: Annotated[Path | None, Option(WHAT, "Run every scene of this file once.", flag="--scenes")] = None
    pool: Annotated[Path | None, Option(WHAT, "The strategy chooses from the scenes of this file.")] = None
    packs: Annotated[
        tuple[Any, ...],
        Option(
            WHAT,
            "Objects and robots from this folder, laid out as SIMPLER and VLATest do; may be repeated.",
            flag="--pack",
            kind=list[str],
        ),
    ] = ()
    store: Annotated[
        Path | None,
        Option(
            OUTPUT,
            "The store; an existing one gets another run.",
            flag="--store",
            default="runs/TASK-POLICY-SEED.db",
        ),
    ] = None
    batch: Annotated[
        int | None,
        Option(
            WHERE,
            "Proposals that are evaluated at a time.",
            default="16; for causes a 75th of the budget, at least 4; for random 64",
        ),
    ] = None
    repeats: Annotated[
        int, Option(JUDGE, "Rollouts per scene; it fails if one of them fails.", default="1")
    ] = 1
    stop_early: Annotated[bool, Option(JUDGE, "End a rollout at its first success.", default="false")] = False
    criteria: Annotated[str, Option(JUDGE, "What success means: strict, or published.", default="strict")] = (
        "strict"
    )
    placement: Annotated[
        str,
        Option(
            JUDGE,
            "How objects come to lie: resting, where the scene has them; published, dropped as in VLATest.",
            default="resting",
        ),
    ] = "resting"
    workers: Annotated[
        int | None,
        Option(
            WHERE,
            "Processes that evaluate scenes.",
            flag="--workers",
            default="as many as there are cores and memory for; 1 for a policy of your own",
        ),
    ] = None
    executor: Annotated[
        str | None,
        Option(
            WHERE,
            "Where scenes are evaluated: local, processes, ray, or ray:auto or ray:HOST:PORT for a cluster.",
            flag="--executor",
            default="local; processes for several",
        ),
    ] = None
    alone: str = field(default_factory=lambda: ALONE + secrets.token_hex(4), compare=False)
    command: str = ""


_HINTS = get_type_hints(RunConfig, include_extras=True)
OPTIONS: dict[str, Option] = {
    name: one for name, hint in _HINTS.items() for one in get_args(hint) if isinstance(one, Option)
}
