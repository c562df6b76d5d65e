"""Which scenes of a store or a file are exported."""

from itertools import chain
from pathlib import Path
from typing import Literal

from vlafuzz.errors import UsageError
from vlafuzz.model.outcome import Verdict
from vlafuzz.model.scene import Scene
from vlafuzz.model.scene_lines import load_scenes
from vlafuzz.store.store import Store

SCENE_FILES = (".jsonl", ".json")  # files without runs and verdicts

Chosen = Literal["failed", "passed", "all"]


def scenes_of(source: Path, run: int | None = None, chosen: Chosen = "failed") -> dict[Scene, str | None]:
    """The distinct scenes of a store with a verdict; all scenes of a file.

    Beside each scene is whether it failed or passed there; None where that is not known.
    """
    if source.suffix in SCENE_FILES:
        if run is not None:
            problem = f"--run {run}: {source} is a file of scenes, not a store"
            raise UsageError(problem, hint="leave out --run")
        return dict.fromkeys(load_scenes(source))
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
