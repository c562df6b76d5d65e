"""A comparison as SARIF, which code hosts show beside the changed files.

SARIF 2.1.0: <https://docs.oasis-open.org/sarif/sarif/v2.1.0/sarif-v2.1.0.html>.
"""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import quote

from vlafuzz import __version__
from vlafuzz.common.files import write_whole, writing
from vlafuzz.errors import printable
from vlafuzz.failures.corpus.corpus import Corpus
from vlafuzz.failures.corpus.folder import CONTROLS, COUNTERPARTS, MANIFEST, SCENES
from vlafuzz.failures.corpus.pairs import Compared, Group
from vlafuzz.failures.corpus.regress import Comparison

RULES = {
    "worse-policy": "The policy fails more often than the baseline.",
    "broken-scene": "The baseline passes in this scene, and the policy fails. One such scene is no evidence.",
}
_FILES: dict[Group, str] = {"control": CONTROLS, "failing": SCENES}


def write_sarif(comparison: Comparison, corpus: Corpus, folder: Path, path: Path) -> None:
    """Write atomically: an alarm is an error, a broken scene a note at its line in the corpus.

    Args:
        folder: of the corpus, as the code host knows it.

    Raises:
        UsageError: the system refuses to write it.
    """
    with writing(path, hint="give --sarif another place"):
        write_whole(path, json.dumps(_log(comparison, corpus, folder), indent=1) + "\n")


def _log(comparison: Comparison, corpus: Corpus, folder: Path) -> dict[str, Any]:
    rules = [{"id": name, "shortDescription": {"text": text}} for name, text in RULES.items()]
    driver = {"name": "vlafuzz", "version": __version__, "rules": rules}
    return {
        "$schema": "https://json.schemastore.org/sarif-2.1.0.json",
        "version": "2.1.0",
        "runs": [{"tool": {"driver": driver}, "results": list(_results(comparison, corpus, folder))}],
    }


def _results(comparison: Comparison, corpus: Corpus, folder: Path) -> Iterator[dict[str, Any]]:
    if comparison.alarm:
        yield _result("worse-policy", "error", comparison.verdict, folder / MANIFEST, 1, comparison.policy)
    lines: dict[Group, list[str]] = {
        "control": [control.scene.digest for control in corpus.controls],
        "failing": [case.scene.digest for case in corpus.cases],
    }
    for scene in comparison.compared:
        if scene.standing != "worse":
            continue
        probe = scene.probe
        known = lines.get(probe.group, [])
        line = known.index(probe.scene.digest) + 1 if probe.scene.digest in known else 1
        file = folder / _FILES.get(probe.group, COUNTERPARTS)
        yield _result("broken-scene", "note", _message(scene), file, line, probe.scene.digest)


def _message(scene: Compared) -> str:
    detail = f": the policy {scene.detail}" if scene.detail else ""
    return f"{scene.probe.scene.instruction} ({scene.probe.group}, {scene.probe.what}){detail}"


def _result(rule: str, level: str, text: str, file: Path, line: int, same: str) -> dict[str, Any]:
    place = {"artifactLocation": {"uri": quote(file.as_posix())}, "region": {"startLine": line}}
    return {
        "ruleId": rule,
        "level": level,
        "message": {"text": _unlinked(text)},
        "locations": [{"physicalLocation": place}],
        "partialFingerprints": {"vlafuzz/v1": same},
    }


def _unlinked(text: str) -> str:
    """Text without links or placeholders, see 3.11.5 and 3.11.6 of the standard."""
    return re.sub(r"[\\\[\]]", r"\\\g<0>", printable(text)).replace("{", "{{").replace("}", "}}")
