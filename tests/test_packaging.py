"""Wheel and sdist, as a user installs them: in an environment of their own, far from the checkout."""

import os
import subprocess
import sys
import sysconfig
import venv
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent


def call(*words: object, cwd: Path) -> str:
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    command = [str(word) for word in words]
    done = subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["wheel", "sdist"])
def test_what_is_installed_fuzzes_with_the_shipped_data(kind, tmp_path):
    call(sys.executable, "-m", "hatchling", "build", "-t", kind, "-d", tmp_path, cwd=ROOT)
    (built,) = [path for path in tmp_path.iterdir() if path.is_file()]
    home = tmp_path / "environment"
    venv.create(home, with_pip=False, symlinks=True)
    python = home / "bin" / "python"
    # the dependencies are those of this environment; the checkout is not among them
    paths = {"base": str(home), "platbase": str(home)}
    site = Path(sysconfig.get_path("purelib", "venv", vars=paths))
    (site / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
    install = ("--python", python, "install", "--quiet", "--no-deps", "--no-build-isolation", built)
    call(sys.executable, "-m", "pip", *install, cwd=tmp_path)
    call(home / "bin" / "vlafuzz", "run", "--policy", "pinhole", "--budget", "8", cwd=tmp_path)
    assert (tmp_path / "runs" / "pick-up-pinhole-0.db").stat().st_size > 0
    where = call(python, "-c", "import vlafuzz; print(vlafuzz.__file__)", cwd=tmp_path)
    assert where.startswith(str(home))
    call(home / "bin" / "vlafuzz", "report", "mini-pick-up", "--no-videos", "--out", "page.html", cwd=tmp_path)
    assert "mini" in (tmp_path / "page.html").read_text(encoding="utf-8")
