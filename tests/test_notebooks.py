"""The notebooks of the documentation run as they are, cell by cell."""

import io
import json
import sys
import types
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

import pytest

DOCS = Path(__file__).parent.parent / "docs"


def cells(name: str) -> list[str]:
    notebook = json.loads((DOCS / name).read_text(encoding="utf-8"))
    assert all(not cell.get("outputs") for cell in notebook["cells"])
    return ["".join(cell["source"]) for cell in notebook["cells"] if cell["cell_type"] == "code"]


def executed(name: str) -> tuple[str, dict[str, Any]]:
    """What a notebook prints, and its variables."""
    variables: dict[str, Any] = {"__name__": "__main__"}
    with redirect_stdout(io.StringIO()) as printed:
        for number, source in enumerate(cells(name), start=1):
            exec(compile(source, f"{name}, cell {number}", "exec"), variables)
    return printed.getvalue(), variables


def test_the_notebook_finds_out_that_the_policy_is_afraid_of_the_dark():
    pytest.importorskip("pandas")
    printed, variables = executed("notebook.ipynb")
    assert "of 16 scenes failed" in printed
    assert "light" in variables["why"].operators
    assert len(variables["findings"]) == variables["run"].findings > 2


@pytest.mark.slow
@pytest.mark.render
def test_the_notebook_with_pictures_shows_a_failure_and_its_witness(monkeypatch):
    shown: list[object] = []
    display = types.ModuleType("IPython.display")
    display.HTML = display.clear_output = object  # tqdm imports more
    display.Image = lambda data: data
    display.Video = lambda data, **_: data
    display.display = shown.append
    monkeypatch.setitem(sys.modules, "IPython", types.ModuleType("IPython"))
    monkeypatch.setitem(sys.modules, "IPython.display", display)
    executed("notebook-pictures.ipynb")
    assert shown[0].startswith(b"\xff\xd8")
    assert all(b"ftyp" in film[:12] for film in shown[1:])
    assert len(shown) >= 2
