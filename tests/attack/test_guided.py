"""Fuzzing of readers guided by coverage, where atheris is installed; `scripts/fuzz_readers.py` does more."""

import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "scripts" / "fuzz_readers.py"


@pytest.mark.slow
@pytest.mark.parametrize("reader", ["scene", "operators", "dae", "glb", "array", "openpi"])
def test_no_input_that_coverage_guides_to_is_a_traceback(reader: str, tmp_path: Path):
    pytest.importorskip("atheris", reason="pip install atheris")
    command = [sys.executable, str(SCRIPT), reader, "-max_total_time=20", "-rss_limit_mb=4096"]
    ended = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=300, check=False)
    assert ended.returncode == 0, ended.stderr[-2000:]
    assert "DONE" in ended.stderr
