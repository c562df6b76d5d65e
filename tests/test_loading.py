"""What a process does not load, so that it starts at once: each in a process of its own."""

import subprocess
import sys
from pathlib import Path

import pytest

HEAVY = ("torch", "sapien", "mani_skill", "ray", "sklearn", "pymoo", "matplotlib", "pandas")
CLI = "from vlafuzz.cli import main; "
DOCTOR = "from vlafuzz.cli import doctor; doctor.machine = lambda: iter(()); doctor.doctor()"
CATALOGUE = "from vlafuzz.worlds.tabletop.objects import load_catalogue as c; [c()[name] for name in c()]"


def loaded_by(code: str, names: tuple[str, ...] = HEAVY) -> list[str]:
    """Which of these libraries and modules a new process has loaded after the code."""
    code += f"\nimport sys\nprint('', *(name for name in {names} if name in sys.modules), file=sys.stderr)"
    child = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return child.stderr.splitlines()[-1].split()  # progress may stand above it, on a slow machine


@pytest.mark.parametrize(
    ("code", "names"),
    [
        ("import vlafuzz", ("numpy", "vlafuzz.api", "vlafuzz.errors")),
        (f"{CLI}assert main(['--help']) == 0", ("torch", "numpy", "pydantic", "vlafuzz.cli.run")),
        (f"{CLI}assert main(['run', '--budget', '0']) == 2", HEAVY),
        (DOCTOR, ("numpy", "pydantic", "scipy", "torch")),
        ("import vlafuzz.campaign.fuzz, vlafuzz.campaign.config", (*HEAVY, "scipy.linalg", "cv2")),
        ("from vlafuzz.rollouts.policies import make_policy; make_policy('mini').spec", HEAVY),
        (CATALOGUE, ("trimesh", "scipy", "PIL", "sapien", "torch")),
    ],
    ids=["the package", "help", "a wrong flag", "doctor", "a campaign", "the spec of mini", "the catalogue"],
)
def test_what_is_not_needed_is_not_loaded(code: str, names: tuple[str, ...]):
    assert loaded_by(code, names) == []


def test_a_run_with_workers_loads_neither_simulator_nor_torch_nor_scikit_learn(tmp_path: Path):
    loaded_by("from vlafuzz.worlds import provenance; provenance._torch()")  # fills the cache
    flags = ["--policy=frozen", "--budget=1", "--workers=2", "--no-certify", f"--store={tmp_path / 'x.db'}"]
    assert loaded_by(f"{CLI}assert main({['run', *flags]}) == 0") == []


@pytest.mark.parametrize("workers", [1, 2])
def test_a_run_in_a_world_of_ones_own_loads_none_of_ours_and_not_torch_nor_do_its_workers(tmp_path: Path, workers: int):
    loaded_by("from vlafuzz.worlds import provenance; provenance._torch()")  # fills the cache
    flags = ["--world=python:tests.worlds.carts:Expert", "--policy=python:tests.worlds.carts:alone", "--unchecked"]
    flags += ["--no-certify", "--budget=9", f"--store={tmp_path / 'x.db'}", f"--workers={workers}"]
    ours = (f"vlafuzz.worlds.{one}" for one in ("tabletop", "tabletop_mujoco", "libero.world"))
    assert loaded_by(f"{CLI}assert main({['run', *flags]}) == 0", ("torch", "scipy.stats", *ours)) == []
