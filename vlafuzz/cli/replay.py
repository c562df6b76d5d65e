"""``vlafuzz replay``."""

import json as json_format
from pathlib import Path
from typing import Annotated

import typer

from vlafuzz.cli.flags import PackFlag, TrustFlag, opened
from vlafuzz.cli.output import print_json, print_rows, stderr
from vlafuzz.errors import UsageError
from vlafuzz.files import write_whole, writing
from vlafuzz.renderer import check_renderer


def command(
    source: Annotated[Path, typer.Argument(help="A store, or a file of JSON scenes.")],
    digest: Annotated[
        str | None, typer.Argument(help="The first digits of a scene's digest.", show_default="first failure")
    ] = None,
    first_failure: Annotated[
        bool, typer.Option("--first-failure", help="The store's first finding.")
    ] = False,
    policy: Annotated[str | None, typer.Option(help="Another policy than the store's.")] = None,
    pack: PackFlag = None,
    video: Annotated[Path | None, typer.Option(help="Write an MP4.")] = None,
    picture: Annotated[Path | None, typer.Option(help="Write a PNG: four moments of the rollout.")] = None,
    seen: Annotated[Path | None, typer.Option(help="Write a PNG: what the policy saw at first.")] = None,
    trace: Annotated[
        Path | None, typer.Option(help="Write JSON: progress and actions, step by step.")
    ] = None,
    trust: TrustFlag = False,
    json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Run one scene or finding again, and show it."""
    if digest and first_failure:
        raise UsageError(f"--first-failure and digest {digest!r} exclude each other", hint="give one of them")
    opened(pack)  # replayed scenes may have their objects
    from vlafuzz.campaign.replay import find, replay

    wanted = find(source, digest, policy)
    filmed = video is not None or picture is not None
    if filmed:
        check_renderer()
    from vlafuzz.sim.maniskill.recording import Recording, write_picture

    recording = Recording(480 if filmed else 0)
    replayed = replay(wanted, policy, recording, must_see=seen is not None)
    if video:
        recording.write_video(video, replayed.hz)
    if picture:
        write_picture(picture, recording.contact_strip())
    if seen:
        write_picture(seen, recording.seen())
    if trace and (document := replayed.trace()):
        with writing(trace):
            write_whole(trace, json_format.dumps(document) + "\n")
    report = replayed.report()
    if json:
        print_json(report)
    else:
        print_rows([{"what": key, "value": value} for key, value in report.items()], title="replay")
    for path in (video, picture, seen, trace):
        if path:
            stderr().print(f"written: {path}")
