"""Training data: demonstrations of the expert where a policy fails, as a LeRobot dataset."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from vlafuzz.common.text import plural
from vlafuzz.common.watch import SILENT, Watch
from vlafuzz.errors import CorpusError, PrerequisiteError, UsageError, install
from vlafuzz.exports.demonstrations import Demonstrations
from vlafuzz.exports.selection import FailingScene, Which, around, at_random, failures_of
from vlafuzz.failures.corpus.folder import check_new, whole
from vlafuzz.policies.clients.model import Interface, interface_of
from vlafuzz.worlds import world_of

TRIES = 4  # scenes that the expert tries for each demonstration, at most


class Written(NamedTuple):
    """The number of episodes, and of scenes that were tried in vain, by reason."""

    demonstrations: int
    left_out: Mapping[str, int]


def write_demonstrations(
    source: Path | str,
    out: Path | str,
    run: int | None = None,
    *,
    which: Which = "failed",
    number: int | None = None,
    workers: int = 1,
    watch: Watch = SILENT,
) -> Written:
    """Let the expert solve failing scenes, and write what the policy would have seen and done as a dataset.

    Args:
        source: store, folder of a corpus, or the name of a shipped corpus.
        out: a new folder.
        run: only failures that this run of a store found.
        which: the failing scenes, or as many ``random`` ones of the same runs.
        number: of demonstrations in all; None for one a scene. From the second of a scene on, it is
            slightly jittered, and the expert begins with another grasp.
        workers: processes.

    Raises:
        PrerequisiteError: LeRobot is not installed, or nothing renders here.
        StoreError: no scene failed; a CorpusError if nothing could be shown.
        UsageError: the failures are of several robots or kinds of policies.
    """
    try:
        from vlafuzz.exports.lerobot import ACTION, STATE, write_dataset
    except ModuleNotFoundError as error:
        message = f"--format lerobot needs the package {error.name!r}"
        raise PrerequisiteError(message, hint=install("lerobot")) from None

    source, out = Path(source), Path(out)
    check_new(out)
    failures = failures_of(source, run)
    interface, robot, hz = _alike(source, failures)
    total = number or len(failures)
    shown = Demonstrations(workers, watch)
    watch.note(f"{plural(total, 'demonstration')} for {plural(len(failures), 'failure')}")
    wanted = at_random(source, failures) if which == "random" else around(source, failures)
    most = total if number is None and which != "random" else TRIES * max(total, len(failures))
    names = {STATE: interface.state_names, ACTION: interface.action_names}
    with whole(out) as folder:
        written = write_dataset(shown.shown(wanted, total, most), folder, hz, robot, names)
        if not written:
            reasons = ", ".join(f"{reason} ({count})" for reason, count in shown.left_out.items())
            raise CorpusError(f"{source}: nothing can be demonstrated: {reasons}", hint="`vlafuzz doctor`")
    return Written(written, shown.left_out)


def _alike(source: Path, failures: Sequence[FailingScene]) -> tuple[Interface, str, int]:
    """The interface, robot and control rate of all failures."""
    kinds: dict[tuple[object, ...], Interface] = {}
    for failure in failures:
        interface = interface_of(failure.run.policy, failure.run.spec)
        pictures = (*interface.spec.cameras, *interface.pictures.values())
        kinds[failure.scene.robot, interface.spec.action, interface.layout, pictures] = interface
    if len(kinds) > 1:
        message = f"{source}: has failures of {len(kinds)} robots, sets of cameras or kinds of actions"
        raise UsageError(message, hint="--run N takes the failures of one run")
    ((robot, *_),), (interface,) = kinds, kinds.values()
    hz = world_of(failures[0].scene.task).robot(str(robot)).control_hz
    return interface, str(robot), hz or interface.spec.action.hz
