"""What all tests share: one thread a process, and no tests of what this machine cannot do."""

import os

# Before anything loads torch or a Vulkan driver. pytest-xdist runs several of these processes.
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("LP_NUM_THREADS", "0")
os.environ.setdefault("VLAFUZZ_WORKERS", "1")

import functools
import re
from collections.abc import Iterator

import hypothesis
import pytest

import vlafuzz.worlds.tabletop.sim  # noqa: F401 - before SAPIEN is
from vlafuzz.worlds.libero import packages as libero
from vlafuzz.worlds.tabletop import renderer

hypothesis.settings.register_profile("quick", deadline=None, max_examples=30)
hypothesis.settings.load_profile("quick")

probe = functools.cache(renderer.probe)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log):
    """With several processes, one of them runs all tests of a file, so that it makes a fixture once.

    One runs all tests on ray. (xdist's own groups rest on a field that pytest 9.2 does not read any more.)
    """
    from xdist.scheduler import LoadScopeScheduling

    class ByFile(LoadScopeScheduling):
        def _split_scope(self, nodeid: str) -> str:
            return "ray" if re.search(r"test_ray|\bray\b", nodeid) else nodeid.partition("::")[0]

    config.option.loadscopereorder = False  # files with few tests, which may take long, do not come last
    return ByFile(config, log)


def pytest_runtest_setup(item: pytest.Item) -> None:
    if item.get_closest_marker("render") and not probe().works:
        pytest.skip(str(probe()))
    if item.get_closest_marker("libero") and libero.missing():
        pytest.skip(f"LIBERO is not installed: {libero.HINT}")


def pytest_terminal_summary(terminalreporter) -> None:
    """Figures that tests measured but may not assert, as they differ between machines."""
    reports = terminalreporter.stats.get("passed", [])
    figures = [value for report in reports for name, value in report.user_properties if name == "figure"]
    if figures:
        terminalreporter.section("figures of this machine")
        terminalreporter.write_line("\n".join(sorted(figures)))


@pytest.fixture(scope="module")
def few_random_scenes() -> Iterator[None]:
    """Shares of causes rest on random scenes by the hundred, which take seconds: on fewer here, each drawn once."""
    from tests.search.worlds import Remembering
    from vlafuzz.failures import regions
    from vlafuzz.search.causes import draws
    from vlafuzz.worlds.tabletop import world

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(world, "SearchSpace", Remembering)
        patched.setattr(draws, "FIRST", 60)
        patched.setattr(regions, "DRAWN", 100)
        yield


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Runs happen in a folder of their own, without a simulator: in the dark, policies fail."""
    from tests.doubles import ClosedForm
    from vlafuzz.campaign import config

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(config, "make_evaluator", lambda manifest, _: ClosedForm(manifest.repeats))
    return tmp_path


@pytest.fixture
def path(tmp_path):
    """Where the fixture ``store`` is."""
    return tmp_path / "runs" / "a.db"


@pytest.fixture
def store(path):
    """An empty store that is open to be written."""
    from vlafuzz.store.store import Store

    with Store.open(path, "write") as opened:
        yield opened


@pytest.fixture(scope="session")
def env():
    """One physics-only environment for everybody; whoever uses it begins a scene first."""
    from tests.worlds.tabletop.sim.scenes import make_env

    made = make_env()
    yield made
    made.close()


@pytest.fixture(scope="session")
def expert_on():
    """``expert_on(task)``: an evaluator of the expert, one a task for everybody."""
    from tests.worlds.tabletop.sim.scenes import evaluator_of
    from vlafuzz.worlds.tabletop.experts.expert import Expert

    made = {}

    def evaluator(task):
        if task not in made:
            made[task] = evaluator_of(Expert(), task=task)
        return made[task]

    yield evaluator
    for each in made.values():
        each.close()


@pytest.fixture(scope="session")
def connected():
    """A ray of this machine, one for all tests that use it: it takes seconds to start.

    These are marked as one group, so that one of pytest's processes runs them all.
    """
    from contextlib import closing

    from tests.doubles import ClosedForm
    from vlafuzz.rollouts.ray import RayExecutor

    with closing(RayExecutor(ClosedForm, workers=2)):
        yield
