"""``vlafuzz list operators`` and ``vlafuzz list objects``."""

from typing import Annotated, Any

import typer

from vlafuzz.cli.flags import CsvFlag, JsonFlag, OperatorsFlag, PackFlag, RobotFlag, opened, option
from vlafuzz.cli.output import print_rows
from vlafuzz.worlds import world_with
from vlafuzz.worlds.capabilities import Catalogued, ListedObject


def operators(
    operators: OperatorsFlag = None,
    task: Annotated[str | None, option("The ranges in this task, where they differ.")] = None,
    robot: RobotFlag = None,
    pack: PackFlag = None,
    json: JsonFlag = False,
    csv: CsvFlag = False,
) -> None:
    """List the operators and their ranges, and refuse a file that `vlafuzz run` refuses."""
    listed = world_with(Catalogued).listed_operators(operators, task, robot, opened(pack))
    if listed.differing and not (json or csv):
        typer.echo(f"ranges differ in {', '.join(listed.differing)}: --task shows them", err=True)
    print_rows(listed.rows, json=json, csv=csv, title=listed.title)


def objects(pack: PackFlag = None, json: JsonFlag = False, csv: CsvFlag = False) -> None:
    """List the objects of the catalogue, or of packs.

    Sizes are those of the bounding box. After each rest pose stands the narrowest grasp in it. JSON and CSV have metres
    and kilograms.
    """
    found = world_with(Catalogued).listed_objects(opened(pack))
    if json or csv:
        print_rows([_row(one, nested=json) for one in found], json=json, csv=csv)
    else:
        print_rows([_shown_row(one) for one in found], title="objects")


def _row(one: ListedObject, *, nested: bool) -> dict[str, Any]:
    """For programs; in CSV, lists and poses are texts."""
    poses = ", ".join(f"{pose} {width:.3f}" if width is not None else pose for pose, width in one.poses.items())
    return {
        "object": one.name,
        "spoken": one.spoken,
        "role": one.role,
        "size": list(one.size) if nested else " × ".join(f"{side:.3f}" for side in one.size),
        "mass": one.mass,
        "rest poses": one.poses if nested else poses,
    }


def _shown_row(one: ListedObject) -> dict[str, Any]:
    """For a terminal: with units."""
    poses = (pose if width is None else f"{pose} {100 * width:.1f} cm" for pose, width in one.poses.items())
    return {
        "object": one.name,
        "role": one.role,
        "size in cm": " × ".join(f"{100 * side:.1f}" for side in one.size),
        "kg": one.mass,
        "rest poses, narrowest grasps": ", ".join(poses),
    }
