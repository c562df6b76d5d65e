"""Flags that several commands have."""

from __future__ import annotations

from typing import Annotated, Any

import typer


def listed(names: str | None) -> tuple[str, ...] | None:
    """Names that are separated by commas; None where no flag is given."""
    return None if names is None else tuple(name.strip() for name in names.split(","))


def _option(flag: str, text: str, default: str | None = None) -> Any:
    return typer.Option(flag, help=text, show_default=default if default else False)


RobotFlag = Annotated[
    str | None,
    _option("--robot", "Whose hand it is: panda; widowx or google, with files from a --pack.", "panda"),
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
ExecutorFlag = Annotated[
    str | None,
    _option(
        "--executor",
        "Where scenes are evaluated: local, processes, or ray.",
        "local; processes for several",
    ),
]
AddressFlag = Annotated[
    str | None, _option("--address", "Of a ray cluster: auto, or host:port.", "a ray of this machine")
]
