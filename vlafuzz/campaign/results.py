"""What became of the scenes of a file that tells how they ended before."""

import json
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from vlafuzz.common.text import plural
from vlafuzz.model.scene_lines import load_verdicts
from vlafuzz.store.store import Store


@dataclass(frozen=True, kw_only=True)
class Again:
    """What became of the scenes of a file that tells how they ended before.

    Attributes:
        failed: scenes that failed before; ``fixed``: of these, those that pass now.
        passed: scenes that passed before; ``broken``: of these, those that fail now.
        not_begun: scenes of both that the run did not come to.
        invalid: those that are no longer fair; ``errors``: those in which policy or simulator broke.
    """

    failed: int
    fixed: int
    passed: int
    broken: int
    not_begun: int
    invalid: int
    errors: int

    def __str__(self) -> str:
        parts = {
            f"{self.fixed} of {plural(self.failed, 'scene')} that failed before pass now": self.failed,
            f"{self.broken} of {plural(self.passed, 'scene')} that passed before fail now": self.passed,
            f"{self.not_begun} not begun": self.not_begun,
            f"{self.invalid} no longer fair": self.invalid,
            f"{self.errors} ended in an error": self.errors,
        }
        return ", ".join(words for words, count in parts.items() if count)


def again(store: Store, run: int) -> Again | None:
    """A run of the scenes of a file beside what the file tells; None where it tells nothing, or is gone."""
    manifest = next(stored.manifest for stored in store.runs() if stored.id == run)
    source = json.loads(manifest.scene_file or "{}")
    if source.get("flag") != "scenes" or not Path(source["file"]).is_file():
        return None
    before = load_verdicts(Path(source["file"]))
    now = {trial.scene.digest: trial.outcome.verdict.name.lower() for trial in store.trials(run)}
    pairs = Counter((verdict, now.get(digest)) for digest, verdict in before.items())
    ended = Counter(now.get(digest) for digest in before)
    if not pairs:
        return None
    count = Counter(before.values())
    return Again(
        failed=count["failed"],
        fixed=pairs["failed", "passed"],
        passed=count["passed"],
        broken=pairs["passed", "failed"],
        not_begun=ended[None],
        invalid=ended["invalid"],
        errors=ended["error"],
    )
