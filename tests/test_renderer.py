import subprocess
import sys

import pytest

from vlafuzz import renderer


@pytest.mark.render
def test_the_picture_comes_out_and_names_the_device():
    result = renderer.probe()
    assert result.device
    assert str(result).startswith("rendering works: ")


def test_without_a_vulkan_driver_it_says_so(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("VK_DRIVER_FILES", "/nonexistent")
    monkeypatch.setenv("VK_ICD_FILENAMES", "/nonexistent")
    result = renderer.probe()
    assert not result.works
    assert str(result).startswith("rendering does not work: ")


@pytest.mark.parametrize(
    ("child", "problem"),
    [
        ("import os; os.abort()", "the driver crashed with signal 6"),
        ("import sys; sys.exit('no luck')", "exit code 1: no luck"),
        ("while True: pass", "no picture within 1 s"),
    ],
)
def test_whatever_the_child_does_is_a_line(child: str, problem: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(renderer, "_CHILD", child)
    assert renderer.probe(timeout=1) == renderer.Renderer(None, None, problem)


def test_importing_it_loads_no_simulator():
    code = "import sys, vlafuzz.renderer; print('sapien' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout == "False\n"
