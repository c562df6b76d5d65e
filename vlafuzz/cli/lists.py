"""``vlafuzz list``: operators, objects, strategies, policies, worlds."""

import inspect
from typing import Annotated, Any

import typer

from vlafuzz.cli.flags import JsonFlag, OperatorsFlag, PackFlag, RobotFlag, opened, option
from vlafuzz.cli.output import print_rows
from vlafuzz.worlds import known_worlds, usual_world, world_of


def operators(
    operators: OperatorsFlag = None,
    task: Annotated[str | None, option("The ranges in this task, where they differ.")] = None,
    robot: RobotFlag = None,
    pack: PackFlag = None,
    json: JsonFlag = False,
) -> None:
    """List the operators and their ranges; with --task, refuse a file that `vlafuzz run` refuses."""
    world = world_of(task) if task else usual_world()
    title, rows, differing = world.listed_operators(operators, task, robot, opened(pack))
    if differing and not json:
        typer.echo(f"ranges differ in {', '.join(differing)}: --task shows them", err=True)
    print_rows(rows, json=json, title=title)


def objects(pack: PackFlag = None, json: JsonFlag = False) -> None:
    """List the objects of the catalogue, or of packs.

    Sizes are those of the bounding box. After each rest pose stands the narrowest grasp in it. JSON has metres.
    """
    rows = usual_world().listed_objects(opened(pack))
    if not json:
        rows = [_in_words(row) for row in rows]
    print_rows(rows, json=json, title="objects")


def _in_words(row: dict[str, Any]) -> dict[str, Any]:
    size = " × ".join(f"{100 * side:.1f}" for side in row["size"])
    poses = [pose if width is None else f"{pose} {100 * width:.1f} cm" for pose, width in row["rest poses"].items()]
    shown = {"object": row["object"], "role": row["role"], "size in cm": size, "kg": row["mass"]}
    return shown | {"rest poses, narrowest grasps": ", ".join(poses)}


def policies(json: JsonFlag = False) -> None:
    """List the policies that can be tested."""
    from vlafuzz.rollouts.policies import known_policies

    print_rows([{"policy": name, "is": says} for name, says in known_policies().items()], json=json, title="policies")


def strategies(json: JsonFlag = False) -> None:
    """List the strategies that propose scenes, the default first."""
    from vlafuzz.campaign.config import STRATEGY
    from vlafuzz.search.registry import STRATEGIES

    rows = []
    for name in dict.fromkeys([STRATEGY, *STRATEGIES]):
        paragraph = (inspect.getdoc(STRATEGIES[name]) or "").partition("\n\n")[0]
        rows.append({"strategy": name, "is": " ".join(paragraph.split())})
    if not json:
        rows[0]["strategy"] += " (default)"
    print_rows(rows, json=json, title="strategies")


def worlds(json: JsonFlag = False) -> None:
    """List the worlds that come with vlafuzz, with their tasks and robots, the defaults first."""
    most = None if json else 8  # tasks in a table
    rows = []
    for name, world in known_worlds().items():
        tasks, robots = list(world.tasks), list(world.robots)
        shown = tasks[:most] + ["…"] * (len(tasks[:most]) < len(tasks))
        row: dict[str, Any] = {"world": name, "tasks": shown, "robots": robots}
        if not json:
            row |= {"tasks": ", ".join(shown), "robots": ", ".join(robots)}
        rows.append(row)
    print_rows(rows, json=json, title="worlds")
