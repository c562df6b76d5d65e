from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.cli.typed import told, typed
from vlafuzz.cli import main
from vlafuzz.common.check import Check
from vlafuzz.doctor import exam
from vlafuzz.worlds.tabletop import renderer, world

LAVAPIPE = renderer.Renderer("llvmpipe", "Mesa 25.0.7", None)
NONE = renderer.Renderer(None, None, "Vulkan finds no device")


@pytest.fixture
def healthy(monkeypatch, tmp_path: Path) -> None:
    monkeypatch.setenv("VLAFUZZ_CACHE", str(tmp_path))
    monkeypatch.setattr(world, "LOADING", "import json")
    monkeypatch.setattr(renderer, "probe", lambda: LAVAPIPE)


def rows(capsys, code: int = 0) -> dict[str, dict[str, str]]:
    return {row["check"]: row for row in told(capsys, "doctor --json", code=code)}


@pytest.mark.usefixtures("healthy")
def test_a_healthy_machine_exits_with_0_and_all_is_well(capsys):
    checks = rows(capsys)
    assert {checks[name]["verdict"] for name in ("python", "simulator", "renderer")} == {"ok"}
    assert "Mesa 25.0.7" in typed(capsys, "doctor").out


@pytest.mark.usefixtures("healthy")
@pytest.mark.parametrize(
    ("imports", "problem"),
    [
        ("import unheard_of", "ModuleNotFoundError: No module named 'unheard_of'"),
        ("import os; os.abort()", "it crashed with signal 6"),
    ],
)
def test_a_simulator_that_is_missing_or_crashes_is_refused_with_exit_code_3(monkeypatch, imports, problem, capsys):
    monkeypatch.setattr(world, "LOADING", imports)
    row = rows(capsys, code=3)["simulator"]
    assert row["verdict"] == "refuse"
    assert row["found"].endswith(f": {problem}")


@pytest.mark.usefixtures("healthy")
def test_no_renderer_is_a_warning_that_says_what_still_runs(monkeypatch, capsys):
    monkeypatch.setattr(renderer, "probe", lambda: NONE)
    row = rows(capsys)["renderer"]
    assert (row["found"], row["verdict"]) == ("Vulkan finds no device", "warn")
    assert "(expert, pinhole) run" in row["follows"]


def test_rows_are_printed_as_they_become_known_and_stay_when_interrupted(monkeypatch, capsys):
    seen: list[str] = []

    def examine(*_: object) -> Iterator[Check]:
        yield Check("sight", "its answers change by 40%", "ok")
        seen.append(capsys.readouterr().out)
        yield Check("hearing", "its answers do not change", "warn", "deaf")
        raise KeyboardInterrupt

    monkeypatch.setattr(exam, "examine", examine)
    assert main(["doctor", "--policy", "pinhole"]) == 130
    assert "its answers change by 40%" in seen[0]
    printed = capsys.readouterr()
    assert "deaf" in printed.out
    assert "interrupted" in printed.err
