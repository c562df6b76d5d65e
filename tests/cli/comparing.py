"""``vlafuzz compare`` with real spaces and strategies, without a simulator."""

import re
from pathlib import Path

from tests.doubles import ClosedForm
from tests.failures.triage.runners import PlantedRunner
from vlafuzz.campaign import launch
from vlafuzz.cli import main
from vlafuzz.failures.triage import scene_runner as runner
from vlafuzz.model.scene import Scene
from vlafuzz.store.store import Store

IDLE = ("--policy", "python:tests.doubles:make_idle")
_SMALL = "--strategies random,feedback --budget 12 --repeats 2 --seed 3 --triage-rollouts 0"
SMALL = (*IDLE, *_SMALL.split())
HERE = ("--store", "a.db", "--out", "out")


def dark(scene: Scene) -> bool:
    return scene.light.intensity < 0.5


def without_simulator(tmp_path: Path, monkeypatch) -> Path:
    """In the dark the policy fails."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(launch, "make_evaluator", lambda manifest, _: ClosedForm(manifest.repeats))
    monkeypatch.setattr(runner, "SimulatorSceneRunner", lambda *_, **__: PlantedRunner([dark]))
    return tmp_path


def compare(*flags: str, code: int = 0) -> None:
    assert main(["compare", *SMALL, *HERE, *flags]) == code


def runs(store: str = "a.db") -> list[tuple[str, int, str]]:
    with Store.open(Path(store)) as opened:
        return [(run.manifest.strategy, run.manifest.seed, run.status) for run in opened.runs()]


def complaint(capsys, *flags: str, code: int = 2) -> str:
    capsys.readouterr()
    assert main(["compare", *SMALL, *HERE, *flags]) == code
    shown = capsys.readouterr().err.splitlines()
    assert [line.partition(": ")[0] for line in shown] == ["error", "hint"], shown
    return shown[0]


def timeless(run: dict[str, object]) -> dict[str, object]:
    return {name: value for name, value in run.items() if not re.search("search|store|^seconds", name)}
