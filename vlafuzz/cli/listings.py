"""``vlafuzz list operators`` and ``vlafuzz list objects``."""

from typing import Annotated, Any

import numpy as np
import typer

from vlafuzz.cli.flags import OperatorsFlag, PackFlag, RobotFlag, opened
from vlafuzz.cli.output import print_rows
from vlafuzz.worlds import known_worlds, world_of
from vlafuzz.worlds.base import Wanted
from vlafuzz.worlds.manipulation.operator_set import load_operators
from vlafuzz.worlds.manipulation.rigs.robots import PANDA, rig
from vlafuzz.worlds.manipulation.space import check_names
from vlafuzz.worlds.tabletop.objects.catalogue import load_catalogue
from vlafuzz.worlds.tabletop.objects.model import ObjectModel
from vlafuzz.worlds.tabletop.tasks import task as task_named


def operators(
    operators: OperatorsFlag = None,
    task: Annotated[str | None, typer.Option(help="The ranges in this task, where they differ.")] = None,
    robot: RobotFlag = None,
    pack: PackFlag = None,
    json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    csv: Annotated[bool, typer.Option("--csv", help="Print CSV.")] = False,
) -> None:
    """List the operators and their ranges, and refuse a file that `vlafuzz run` refuses."""
    setup, packs = rig(robot or PANDA.robot), opened(pack)
    catalogue = load_catalogue(packs=packs)
    chosen = load_operators(operators or setup.operators)
    check_names(chosen, {*catalogue, *(name for world in known_worlds().values() for name in world.objects)})
    if task is not None:
        wanted = Wanted(task=task_named(task).name, robot=setup.robot, packs=packs)
        world_of(task).space(wanted, chosen)
        chosen = chosen.in_task(task)
    elif chosen.tasks and not (json or csv):
        typer.echo(f"ranges differ in {', '.join(sorted(chosen.tasks))}: --task shows them", err=True)
    rows = [
        {
            "operator": name,
            "changes": operator.says,
            "range": operator.ranges(),
            "nominal": operator.nominally(),
            "varies": "yes" if name in chosen.varied else "no",
        }
        for name, operator in chosen.operators.items()
    ]
    title = f"{chosen.source.stem}: {chosen.min_distance:g} m between the centres of any two objects"
    bounds = f"a target counts as visible with at least {chosen.visible}"
    seen = bounds if chosen.visible else "targets need not be visible"
    print_rows(rows, json=json, csv=csv, title=f"{title}; {seen}")


def objects(
    pack: PackFlag = None,
    json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    csv: Annotated[bool, typer.Option("--csv", help="Print CSV.")] = False,
) -> None:
    """List the objects of the catalogue, or of packs.

    Sizes are those of the bounding box. After each rest pose stands the narrowest grasp in it. JSON and CSV
    have metres and kilograms.
    """
    catalogue = load_catalogue(packs=opened(pack))
    models = [catalogue[name] for name in catalogue.preferred(catalogue.names())]
    if json or csv:
        print_rows([_row(model, nested=json) for model in models], json=json, csv=csv)
    else:
        print_rows([_shown_row(model) for model in models], title="objects")


def _row(model: ObjectModel, *, nested: bool) -> dict[str, Any]:
    size = [round(float(side), 4) for side in np.ptp(model.vertices, axis=0)]
    poses = {
        pose.name: min((grasp.width for grasp in pose.grasps), default=None) for pose in model.stable_poses
    }
    return {
        "object": model.name,
        "spoken": model.spoken,
        "role": model.role,
        "size": size if nested else " × ".join(f"{side:.3f}" for side in size),
        "mass": model.mass,
        "rest poses": poses if nested else ", ".join(_shown(*pose) for pose in poses.items()),
    }


def _shown_row(model: ObjectModel) -> dict[str, Any]:
    """For a terminal: with units."""
    row = _row(model, nested=True)
    poses = (
        pose if width is None else f"{pose} {100 * width:.1f} cm" for pose, width in row["rest poses"].items()
    )
    return {
        "object": model.name,
        "role": model.role,
        "size in cm": " × ".join(f"{100 * side:.1f}" for side in row["size"]),
        "kg": model.mass,
        "rest poses, narrowest grasps": ", ".join(poses),
    }


def _shown(pose: str, narrowest: float | None) -> str:
    return pose if narrowest is None else f"{pose} {narrowest:.3f}"
