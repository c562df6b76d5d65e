"""Flags that several commands have."""

from __future__ import annotations

from typing import Annotated

import typer


def listed(names: str | None) -> tuple[str, ...] | None:
    """Names that are separated by commas; None where no flag is given."""
    return None if names is None else tuple(name.strip() for name in names.split(","))


RobotFlag = Annotated[
    str | None,
    typer.Option(
        "--robot",
        help="Whose hand it is: panda; widowx or google, with files from a --pack.",
        show_default="panda",
    ),
]
OperatorsFlag = Annotated[
    str | None,
    typer.Option(
        "--operators", help="YAML file of ranges, or a shipped one's name.", show_default="tabletop"
    ),
]
VaryFlag = Annotated[
    str | None, typer.Option("--vary", help="Only these operators vary: light,camera-position,…")
]
PlacementFlag = Annotated[
    str | None,
    typer.Option(
        "--placement",
        help="How objects come to lie: resting, where the scene has them; published, dropped as in VLATest.",
        show_default="resting",
    ),
]
ExecutorFlag = Annotated[
    str | None,
    typer.Option(
        "--executor",
        help="Where scenes are evaluated: local, processes, or ray.",
        show_default="local; processes for several",
    ),
]
AddressFlag = Annotated[
    str | None,
    typer.Option(
        "--address", help="Of a ray cluster: auto, or host:port.", show_default="a ray of this machine"
    ),
]
