"""``vlafuzz replay``."""

from pathlib import Path
from typing import Annotated

import typer

from vlafuzz.cli.flags import JsonFlag, PackFlag, TrustFlag, opened, option
from vlafuzz.cli.output import print_json, print_rows, stderr

SIZE = 480  # height of a film, pixels


def command(
    source: Annotated[Path, typer.Argument(help="A store, or a file of JSON scenes.")],
    digest: Annotated[
        str | None,
        typer.Argument(help="The first digits of a scene's digest.", show_default="the one that `run` named"),
    ] = None,
    policy: Annotated[str | None, option("Another policy than the store's.")] = None,
    pack: PackFlag = None,
    video: Annotated[Path | None, option("Write an MP4.")] = None,
    seen: Annotated[Path | None, option("Write a PNG: what the policy saw at first.")] = None,
    rrd: Annotated[
        Path | None,
        option("Write a recording for the viewer of Rerun. Of a stored failure it executes the stored actions."),
    ] = None,
    film: Annotated[
        bool | None,
        option(
            "Write an MP4 beside the source.",
            "if nothing else is written or printed as JSON, and pictures work here",
            flag="--film/--no-film",
        ),
    ] = None,
    trust: TrustFlag = False,
    json: JsonFlag = False,
) -> None:
    """Run one scene or failure again, and show it: what is unusual in it, and a film of what goes wrong."""
    opened(pack)  # replayed scenes may have their objects
    from vlafuzz.campaign.replay import find, replay
    from vlafuzz.failures.described import unusual
    from vlafuzz.worlds import no_pictures, world_of
    from vlafuzz.worlds.recording import Recording, write_picture
    from vlafuzz.worlds.rerun import RerunRecording

    wanted = find(source, digest, policy)
    if film is None:
        film = not (json or video or seen or rrd) and not no_pictures(wanted.scene.task)
    if film and video is None:
        video = source.with_name(f"{source.stem}-{wanted.scene.digest[:12]}.mp4")
    if video:
        world_of(wanted.scene.task).check_pictures()
    size = SIZE if video or (rrd and not no_pictures(wanted.scene.task)) else 0
    recording = RerunRecording(size) if rrd else Recording(size)
    play = rrd is not None and not seen  # what a policy saw, only the policy can tell
    replayed = replay(wanted, policy, recording, must_see=seen is not None, play=play)
    if rrd and isinstance(recording, RerunRecording):
        recording.write(rrd)
        if play and policy is None and replayed.report["same trajectory as stored"] is False:
            name = wanted.conditions.policy
            stderr().print(
                f"note: the stored actions, of 32 bits, lead elsewhere; --policy {name} asks the policy again"
            )
    if video:
        recording.write_video(video, replayed.hz)
    if seen:
        write_picture(seen, recording.seen())
    for path in filter(None, (video, seen, rrd)):
        stderr().print(f"written: {path}")
    report = replayed.report | {"unusual": unusual(source, wanted.scene, wanted.conditions)}
    if json:
        print_json(report)
        return
    said = {key: value for key, value in report.items() if value not in (None, "", [])}
    shown = {key: "\n".join(map(str, value)) if isinstance(value, list) else value for key, value in said.items()}
    print_rows([{"what": key, "value": value} for key, value in shown.items()], title="replay")
