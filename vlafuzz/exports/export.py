"""Export scenes for other programs, as files of scenes."""

from collections.abc import Mapping
from itertools import chain
from pathlib import Path
from typing import Literal, NamedTuple

from vlafuzz.common.files import writing
from vlafuzz.errors import UsageError
from vlafuzz.model.outcome import Verdict
from vlafuzz.model.scene import Scene
from vlafuzz.model.scene_lines import is_document, load_verdicts, write_scenes
from vlafuzz.store.store import Store
from vlafuzz.worlds import world_with
from vlafuzz.worlds.capabilities import SceneFormats

SCENE_FILES = (".jsonl", ".json")  # files without runs and verdicts

Chosen = Literal["failed", "passed", "all"]


class Exported(NamedTuple):
    """The number written, and the numbers left out, by reason."""

    written: int
    left_out: Mapping[str, int]


def scenes_of(source: Path, run: int | None = None, chosen: Chosen = "failed") -> dict[Scene, str | None]:
    """The distinct scenes of a store with a verdict; all scenes of a file, VLATest's unchanged.

    Beside each scene is whether it failed or passed there; None where that is not known.
    """
    if source.suffix in SCENE_FILES:
        if run is not None:
            problem = f"--run {run}: {source} is a file of scenes, not a store"
            raise UsageError(problem, hint="leave out --run")
        scenes = world_with(SceneFormats).read_scene_file(source, "original").scenes()
        told = {} if is_document(source) else load_verdicts(source)
        return {scene: told.get(scene.digest) for scene in scenes}
    with Store.open(source) as store:
        if chosen == "failed":
            return dict.fromkeys((finding.scene for finding in store.findings(run)), chosen)
        runs = [stored.id for stored in store.runs()] if run is None else [run]
        verdicts: dict[Scene, str | None] = {}
        for trial in chain.from_iterable(map(store.trials, runs)):
            verdict = trial.outcome.verdict.name.lower()
            if chosen == "all" or verdict == chosen:
                before = verdicts.get(trial.scene)
                judged = trial.outcome.verdict >= Verdict.PASSED
                verdicts[trial.scene] = verdict if judged and before != "failed" else before
        return verdicts


def write_file(out: Path, scenes: Mapping[Scene, str | None], layout: str) -> Exported:
    """Write scenes to one file, in the layout ``vlafuzz``, with their verdicts, or ``vlatest``."""
    left_out: Mapping[str, int] = {}
    with writing(out):
        if layout == "vlafuzz":
            write_scenes(out, scenes, scenes)
        else:
            left_out = world_with(SceneFormats).export_scenes(out, list(scenes))
    return Exported(len(scenes) - sum(left_out.values()), left_out)
