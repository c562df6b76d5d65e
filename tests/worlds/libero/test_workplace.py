"""Evaluators of one process take turns with environments."""

import subprocess
import sys
from collections.abc import Iterator

import pytest

from vlafuzz.model import Conditions, Scene
from vlafuzz.policies.controls import Frozen
from vlafuzz.rollouts.setup import make_evaluator
from vlafuzz.worlds.evaluator import SceneEvaluator, drive, proceed
from vlafuzz.worlds.libero import evaluator as workplace
from vlafuzz.worlds.libero.space import nominal_scene

pytestmark = pytest.mark.libero
TASK = "libero_object/0"


@pytest.fixture
def built(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[str]]:
    """The tasks for which something was built."""
    workplace.close_idle()
    tasks: list[str] = []
    own = workplace.LiberoEnv

    def counted(task, **options):
        tasks.append(str(task))
        return own(task, **options)

    monkeypatch.setattr(workplace, "LiberoEnv", counted)
    yield tasks
    workplace.close_idle()


def scene() -> Scene:
    return nominal_scene(TASK, "libero")


def test_a_process_ends_without_a_word_after_it_has_drawn():
    code = (
        "from tests.worlds.libero.test_workplace import *\n"
        "from vlafuzz.worlds.recording import Recording\n"
        "drawing = make_evaluator(Conditions(task=TASK, robot='libero'), Frozen(), recording=Recording(64))\n"
        "drawing.begin(scene(), 0).picture('recording'); drawing.leave()"
    )
    child = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert (child.stdout, child.stderr) == ("", "")


def evaluator() -> SceneEvaluator:
    return make_evaluator(Conditions(task=TASK, robot="libero"), Frozen())


def test_one_evaluator_after_another_uses_the_same_environment_until_it_is_renewed(built):
    first, second = evaluator(), evaluator()
    hashes = [one.evaluate([scene()])[0].rollouts[0].states_hash for one in (first, second)]
    first.close()
    assert built == [TASK]
    second.renew()
    hashes.append(second.evaluate([scene()])[0].rollouts[0].states_hash)
    assert built == [TASK, TASK]
    assert len(set(hashes)) == 1


def test_rollouts_at_the_same_time_have_an_environment_each(built):
    first, second = evaluator(), evaluator()
    waiting = first.evaluation(scene())
    asked = proceed(waiting, None)
    other = drive(second.evaluation(scene()), Frozen())
    assert built == [TASK, TASK]
    while hasattr(asked, "images"):
        asked = proceed(waiting, Frozen().act([asked])[0])
    assert asked.rollouts[0].states_hash == other.rollouts[0].states_hash
