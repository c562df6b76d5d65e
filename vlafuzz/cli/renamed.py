"""Names that commands and options had before: each is answered with a sentence that gives today's name."""

from collections.abc import Mapping, Sequence

from vlafuzz.errors import UsageError

COMMANDS: Mapping[str, str] = {
    "subjects": "list policies",
    "policies": "list policies",
    "strategies": "list strategies",
    "operators": "list operators",
    "objects": "list objects",
    "import": "export FILE.json --out F.jsonl",
    "merge": "export A.db B.db --format store --out F.db",
    "findings": "report STORE",
    "watch": "report STORE --follow",
    "study": "lab study",
    "coverage": "lab coverage",
}

_CLUSTER = {"--address": "--executor ray:ADDRESS"}
_CONFIG = {
    "--batch": "batch=8",
    "--criteria": "criteria=published",
    "--fail-on-finding": "fail-on-finding=true",
    "--placement": "placement=published",
    "--pool": "pool=FILE",
    "--quality": "quality=fast",
    "--repeats": "repeats=3",
    "--stop-early": "stop-early=true",
    "--triage": "triage=true",
}
OPTIONS: Mapping[str, Mapping[str, str]] = {
    "run": _CLUSTER
    | {"--table": "`vlafuzz report STORE --out rates.csv`"}
    | {flag: f"--config {value}" for flag, value in _CONFIG.items()},
    "compare": _CLUSTER,
}


def check_names(words: Sequence[str]) -> None:
    """Raise a UsageError that gives the new name of a command or option, if the words have an old one."""
    command = words[0] if words else ""
    if command in COMMANDS:
        raise UsageError(f"`vlafuzz {command}` is `vlafuzz {COMMANDS[command]}` now")
    old = {"--subject": "--policy NAME"} | dict(OPTIONS.get(command, {}))
    for word in words:
        if (flag := word.partition("=")[0]) in old:
            raise UsageError(f"{flag}: this is {old[flag]} now")
