"""``vlafuzz list``: operators, objects, strategies, policies, worlds."""

import inspect
from typing import Annotated, Any

import typer

from vlafuzz.cli.flags import CsvFlag, JsonFlag, OperatorsFlag, PackFlag, RobotFlag, opened, option
from vlafuzz.cli.output import print_rows
from vlafuzz.worlds import known_worlds, world_with
from vlafuzz.worlds.capabilities import Catalogued


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
    rows: list[dict[str, Any]] = []
    scale, digits, unit = (1, 3, "") if json or csv else (100, 1, " cm")
    for one in world_with(Catalogued).listed_objects(opened(pack)):
        size = " × ".join(f"{scale * side:.{digits}f}" for side in one.size)
        poses = ", ".join(
            pose if width is None else f"{pose} {scale * width:.{digits}f}{unit}" for pose, width in one.poses.items()
        )
        if not (json or csv):
            row = {"object": one.name, "role": one.role, "size in cm": size, "kg": one.mass}
            rows.append(row | {"rest poses, narrowest grasps": poses})
            continue
        row = {"object": one.name, "spoken": one.spoken, "role": one.role, "size": one.size if json else size}
        rows.append(row | {"mass": one.mass, "rest poses": one.poses if json else poses})
    print_rows(rows, json=json, csv=csv, title="objects")


def policies(json: JsonFlag = False, csv: CsvFlag = False) -> None:
    """List the policies that can be tested."""
    from vlafuzz.policies.clients.options import known_profiles
    from vlafuzz.policies.clients.servers import client
    from vlafuzz.rollouts.policies import known_policies

    rows = [{"policy": name, "is": says} for name, says in known_policies().items()]
    rows += [
        {"policy": f"{client(protocol).form}?profile={name}", "is": profile.about}
        for name, profile in known_profiles().items()
        for protocol in profile.protocols
    ]
    print_rows(rows, json=json, csv=csv, title="policies")


def strategies(json: JsonFlag = False, csv: CsvFlag = False) -> None:
    """List the strategies that propose scenes, the default first."""
    from vlafuzz.campaign.config import STRATEGY
    from vlafuzz.search.registry import STRATEGIES

    rows = []
    for name in dict.fromkeys([STRATEGY, *STRATEGIES]):
        paragraph = (inspect.getdoc(STRATEGIES[name]) or "").partition("\n\n")[0]
        rows.append({"strategy": name, "is": " ".join(paragraph.split())})
    if not (json or csv):
        rows[0]["strategy"] += " (default)"
    print_rows(rows, json=json, csv=csv, title="strategies")


def worlds(json: JsonFlag = False, csv: CsvFlag = False) -> None:
    """List the worlds that come with vlafuzz, with their tasks and robots, the defaults first."""
    most = None if json or csv else 8  # tasks in a table
    rows = []
    for name, world in known_worlds().items():
        tasks, robots = list(world.tasks), list(world.robots)
        shown = tasks[:most] + ["…"] * (len(tasks[:most]) < len(tasks))
        row: dict[str, Any] = {"world": name, "tasks": shown, "robots": robots}
        if not json:
            row |= {"tasks": ", ".join(shown), "robots": ", ".join(robots)}
        rows.append(row)
    print_rows(rows, json=json, csv=csv, title="worlds")
