"""Flags that several commands have."""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from vlafuzz.cli.output import Bar


class Frame(StrEnum):
    """How VLATest's table frame is mapped to ours."""

    FIT = "fit"
    KEEP = "keep"
    ORIGINAL = "original"
    ROBOT = "robot"


def listed(names: str | None) -> tuple[str, ...] | None:
    """Names that are separated by commas; None where no flag is given."""
    return None if names is None else tuple(name.strip() for name in names.split(","))


def _option(flag: str, text: str, default: str | None = None) -> Any:
    return typer.Option(flag, help=text, show_default=default if default else False)


def label_option(flag: str, text: str, default: str = "") -> Any:
    """An option that takes a label, and refuses what does not fit into a line of text."""

    def checked(label: str | None) -> str | None:
        from vlafuzz.model.label import check_label

        check_label(flag, label)
        return label

    return typer.Option(flag, help=text, show_default=default or False, callback=checked)


RobotFlag = Annotated[
    str | None,
    _option("--robot", "Whose hand it is: panda; widowx or google, with files from a --pack.", "panda"),
]
PolicyFlag = Annotated[
    str | None,
    _option(
        "--policy",
        "The policy under test, or python:pkg.mod:factory.",
        "mini, or pinhole where nothing renders",
    ),
]
LabelFlag = Annotated[
    str | None,
    label_option(
        "--label",
        "Which model the policy is: stored outcomes answer only under the same label.",
        "behind a server none, so that none answer",
    ),
]
ServedFlag = Annotated[
    str | None,
    label_option("--label", "Of models that are served at one address in turn, the one that answers now."),
]
AnswersFlag = Annotated[
    Path | None, _option("--answers", "Keep outcomes by model in this file, and reuse those in it.")
]
OperatorsFlag = Annotated[
    str | None, _option("--operators", "YAML file of ranges, or a shipped one's name.", "tabletop")
]
VaryFlag = Annotated[str | None, _option("--vary", "Only these operators vary: light,camera-position,…")]
PlacementFlag = Annotated[
    str | None,
    _option(
        "--placement",
        "How objects come to lie: resting, where the scene has them; published, dropped as in VLATest.",
        "resting",
    ),
]
WorkersFlag = Annotated[
    int | None,
    typer.Option(
        help="Processes that evaluate scenes.",
        show_default="as many as there are cores and memory for; 1 for a policy of your own",
    ),
]
ExecutorFlag = Annotated[
    str | None,
    _option(
        "--executor", "Where scenes are evaluated: local, processes, or ray.", "local; processes for several"
    ),
]
AddressFlag = Annotated[
    str | None, _option("--address", "Of a ray cluster: auto, or host:port.", "a ray of this machine")
]
TimeFlag = Annotated[
    str | None, _option("--time", "Wall clock that it takes at most: 1h, 30m, 90s, 1h30m.", "no limit")
]


TrustFlag = Annotated[
    bool,
    typer.Option(
        "--trust", help="Load code (python:…) and ask servers that the file names, not only those you name."
    ),
]
PackFlag = Annotated[
    list[str] | None,
    typer.Option(
        "--pack",
        help="Objects and robots from this folder, laid out as SIMPLER and VLATest do; may be repeated.",
    ),
]


def opened(folders: Sequence[str] | None) -> tuple[Any, ...]:
    """The packs in these folders; notes say what is missing in them.

    Raises:
        UsageError: a folder is no pack and has none in it.
        CatalogueError: a mesh is damaged.
    """
    if not folders:
        return ()
    # Imported late: `vlafuzz doctor` has to start anywhere.
    from vlafuzz.worlds import world_with
    from vlafuzz.worlds.capabilities import Catalogued

    with Bar() as bar:
        return world_with(Catalogued).open_packs(folders, bar)
