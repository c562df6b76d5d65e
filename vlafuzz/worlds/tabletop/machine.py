"""Checks of this machine: the simulator's packages, and what draws pictures."""

from collections.abc import Iterator

from vlafuzz.common.check import Check
from vlafuzz.common.child import tried
from vlafuzz.worlds.provenance import versions
from vlafuzz.worlds.tabletop import renderer

_IMPORT = "import mani_skill.envs"  # with all that it needs, such as sapien and torch


def checks() -> Iterator[Check]:
    """All checks; they take some seconds, mostly for loading the simulator."""
    found = ", ".join(f"{package} {version}" for package, version in versions().items() if package != "vlafuzz")
    problem = import_problem()
    if problem:
        yield Check("simulator", f"{found}: {problem}", "refuse", "no scene can be simulated; hint: run scripts/setup")
    else:
        yield Check("simulator", found)
    probed = renderer.probe()
    if probed.works:
        software = "llvmpipe" in (probed.device or "")
        yield Check("renderer", probed.name, "ok", "in software: pictures cost more than physics" if software else "")
    else:
        lost = "policies without camera (expert, pinhole) run; pictures, videos and policies that see do not"
        yield Check("renderer", probed.problem or "", "warn", f"{lost}; hint: {renderer.HINT}")


def import_problem() -> str:
    """Why the simulator cannot be imported, empty if it can."""
    _, problem = tried(_IMPORT, 180.0)
    return problem
