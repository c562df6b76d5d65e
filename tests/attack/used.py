"""Commands that go on with what somebody changed: with a simulator whose outcomes are known at once."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest import mock

import yaml

from tests.attack import mutators, samples
from tests.attack.reactions import command
from tests.attack.readers import Reader, Rng
from tests.attack.stored import changed_corpus, changed_store
from tests.doubles import ClosedForm, passed
from vlafuzz.campaign import replay as replaying
from vlafuzz.failures.described import unusual
from vlafuzz.model import Outcome, Scene
from vlafuzz.rollouts.policies import built_in

PLACES = ("campaign.config", "campaign.replay", "rollouts.scene_runner")
RUN = {
    "task": "pick-up", "strategy": "random", "vary": ["light", "camera-position"], "batch": 2, "repeats": 1,
    "time": "1m", "label": "a", "operators": "tabletop", "robot": "panda",
    "stop-early": True, "pack": ["mine"], "scenes": "a.jsonl",
}  # fmt: skip


class Known(ClosedForm):
    """Experts solve every scene, policies those that are bright."""

    seed = 0

    def __init__(self, policy: Any) -> None:
        super().__init__()
        self._solves = policy.spec.name not in built_in() or policy.spec.name in ("expert", "seeing")

    def renew(self) -> None:
        pass

    def outcome(self, scene: Scene) -> Outcome:
        return passed() if self._solves else super().outcome(scene)


@contextmanager
def _known() -> Iterator[None]:
    def make(_: Any, policy: Any, **__: Any) -> Known:
        return Known(policy)

    patches = [mock.patch(f"vlafuzz.{place}.make_evaluator", make) for place in PLACES]
    with patches[0], patches[1], patches[2]:
        yield


def triage(rng: Rng, folder: Path) -> None:
    path = changed_store(rng, samples.untriaged(), folder)
    with _known():
        command("triage", path, "--limit", 1, "--workers", 1, "--time", "2s")


def regress(rng: Rng, folder: Path) -> None:
    copied = changed_corpus(rng, folder)
    with _known():
        command("regress", copied, "--policy", "frozen", "--time", "2s")


def replay(rng: Rng, folder: Path) -> None:
    path = changed_store(rng, samples.untriaged(), folder)
    with _known():
        wanted = replaying.find(path)
        json.dumps(replaying.replay(wanted).report, allow_nan=False)
        unusual(path, wanted.scene, wanted.conditions)


def config(rng: Rng, folder: Path) -> None:
    """Flags in a file; those that decide how long it takes are given beside it."""
    names = rng.choice(list(RUN), size=int(rng.integers(1, 4)), replace=False)
    content = mutators.tree(rng, {str(name): RUN[str(name)] for name in names})
    path = folder / "a.yaml"
    if rng.random() < 0.3:
        path.write_bytes(mutators.data(rng, yaml.safe_dump(RUN).encode()))
    else:
        path.write_text(json.dumps(content))
    short = "--budget 2 --config batch=2 --config repeats=1 --workers 1 --executor local --no-certify"
    with _known():
        command("run", "--config", path, "--policy", "frozen", "--store", folder / "a.db", *short.split())


USED: dict[str, tuple[Reader, int]] = {
    "triage": (triage, 600),
    "regress": (regress, 600),
    "replay": (replay, 1000),
    "config": (config, 1000),
}
"""As ``READERS``."""
