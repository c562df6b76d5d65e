"""Defects of worlds that their checks name, and sound worlds of which they say nothing."""

from pathlib import Path

import pytest

from tests.cli.typed import typed
from tests.worlds import carts, later_defects
from vlafuzz.common.check import Check
from vlafuzz.stored import StoredResults
from vlafuzz.worlds import soundness
from vlafuzz.worlds.soundness import examine

MODULE = "python:tests.worlds.carts"
# The world, the check that names its defect, and a word of the sentence.
DEFECTS = (
    ("GlobalGenerator", "resets", "numpy.random or random"),
    ("IgnoresSeed", "resets", "the seed is ignored"),
    ("StepsByChance", "steps", "numpy.random or random"),
    ("KeepsState", "repeats", "after a rollout the nominal scene is another one"),
    ("AppliesLate", "repeats", "at the next reset only"),
    ("DependsOnProcess", "processes", "another process has another rollout"),
    ("SwappedUnit", "values", "its unit is swapped, or"),
    ("SwapsCategories", "values", "ice was set, the simulator has felt"),
    ("ClipsReadBack", "values", "mass (how heavy the cart is): 2.7 kg was set, the simulator has 2.5 kg"),
    ("IgnoresReadBack", "values", "0.5 kg was set, the simulator has 2 kg"),
    ("IgnoresValue", "effects", "mass (how heavy the cart is): no effect"),
    ("Clips", "effects", "mass (how heavy the cart is): clipped, 2.7 kg to 4 kg act alike"),
    ("MapsCategoryWrongly", "effects", "floor: ice and felt act alike"),
    ("OtherNominal", "nominal", "the nominal scene differs from the environment's own"),
    ("Solved", "start", "the nominal scene is solved before the first step"),
    ("NoSuccess", "world", "define success(now)"),
    ("LazyExpert", "expert", "it does not solve the nominal scene"),
    ("ShortExpert", "expert", "of 20 random scenes: narrow the range"),
    ("DrawsDifferently", "pictures", "drawn differently a second time"),
    ("DrawingMoves", "pictures", "render must change no state"),
    ("DrawingCrashes", "pictures", "drawing raises RuntimeError: no display"),
)
LATER = (
    ("SeedsWhenMade", "repeats", "a second reset with the same seed begins differently"),
    ("WearsOut", "repeats", "after a rollout the nominal scene is another one"),
    ("Accumulates", "repeats", "after other values the nominal scene is another one"),
    ("HashOfText", "processes", "another process has another rollout"),
    ("RealTime", "steps", "a step draws by chance"),
    ("Swapped", "values", "0.5 kg was set, the simulator has 1.5 kg"),
    ("ClipsBelow", "effects", "clipped, 0.5 kg to 1.4 kg act alike"),
    ("OptionsFallBack", "effects", "floor: wood and felt act alike"),
    ("NotFinite", "effects", "an observation is not finite at 0.5 kg"),
    ("SolvedNear", "start", "mark: the scene is solved before the first step at 0 m"),
    ("IgnoresActions", "steps", "step ignores its action"),
    ("PictureLate", "pictures", "the first picture of the same scene is another one"),
)


def findings(name: str) -> dict[str, Check]:
    own = name in ("DependsOnProcess", "HashOfText")  # only these need a process, which takes seconds
    module = carts if hasattr(carts, name) else later_defects
    reference = f"python:{module.__name__}:{name}" if own else ""
    return {found.check: found for found in examine(getattr(module, name)(), "reach", reference)}


@pytest.mark.parametrize(("name", "check", "words"), DEFECTS + LATER, ids=[row[0] for row in DEFECTS + LATER])
def test_a_defect_is_named_by_its_check_and_by_no_other(name: str, check: str, words: str):
    found = findings(name).values()
    bad = {one.check: one for one in found if one.verdict != "ok" and one.check != "not checked"}
    assert list(bad) == [check]
    assert words in f"{bad[check].found}: {bad[check].follows}"


@pytest.mark.parametrize("name", ["Carts", "ReadBack", "Expert", "NoSeedNeeded"])
def test_nothing_is_said_of_a_sound_world(name: str):
    assert [found for found in findings(name).values() if found.verdict != "ok"] == []


def test_what_a_refusal_leaves_unchecked_is_named():
    *_, refused, last = examine(carts.KeepsState(), "reach", f"{MODULE}:KeepsState")
    assert (refused.check, last.check) == ("repeats", "not checked")
    assert last.found == "processes, values, effects, nominal, start, expert, pictures"


def test_values_for_which_no_time_was_left_are_named(monkeypatch):
    monkeypatch.setattr(soundness, "LONG", 0.0)
    assert findings("Carts")["not checked"].found == "the effects of mass, mark, slope, floor"


def test_doctor_checks_a_world_also_in_another_process(capsys):
    out = typed(capsys, f"doctor --world {MODULE}:ReadBack").out
    assert "another process has the same rollout" in " ".join(out.split())
    typed(capsys, f"doctor --world {MODULE}:Solved:reach", code=3)


def test_a_world_that_comes_with_vlafuzz_is_not_checked_that_way(capsys):
    assert "this world comes with vlafuzz" in typed(capsys, "doctor --world tabletop", code=2).err


def first_run(folder: Path, capsys, world: str, *flags: str, code: int = 0) -> str:
    """What ``vlafuzz run`` says of a world whose cache is in a folder."""
    asked = f"run --world {world} --policy {MODULE}:sliding --strategy random --budget 1"
    return " ".join(typed(capsys, [*asked.split(), "--store", str(folder / "a.db"), *flags], code=code).err.split())


def test_a_world_is_looked_at_where_it_is_first_used_and_again_after_a_change(tmp_path: Path, capsys, monkeypatch):
    monkeypatch.setenv("VLAFUZZ_CACHE", str(tmp_path / "cache"))
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "fresh_cart.py").write_text("from tests.worlds.carts import Expert\nclass Mine(Expert): ...\n")
    new, world = "python:fresh_cart:Mine is new here", "python:fresh_cart:Mine"
    assert new in first_run(tmp_path, capsys, world)
    assert new not in first_run(tmp_path, capsys, world)
    with (tmp_path / "fresh_cart.py").open("a") as file:
        file.write("# changed")
    assert new in first_run(tmp_path, capsys, world)


def test_a_world_whose_resets_differ_is_not_run_unless_it_is_asked_for(tmp_path: Path, capsys, monkeypatch):
    monkeypatch.setenv("VLAFUZZ_CACHE", str(tmp_path))
    for _ in range(2):  # what cannot be believed is not remembered
        said = first_run(tmp_path, capsys, f"{MODULE}:GlobalGenerator", code=3)
        assert "is not run: resets: two new environments begin differently" in said
        assert not (tmp_path / "a.db").exists()
    assert "resets" not in first_run(tmp_path, capsys, f"{MODULE}:GlobalGenerator", "--unchecked")
    said = first_run(tmp_path, capsys, f"{MODULE}:OtherNominal")
    assert "note: python:tests.worlds.carts:OtherNominal: nominal:" in said


def test_a_world_that_the_doctor_has_checked_is_not_new(tmp_path: Path, capsys, monkeypatch):
    monkeypatch.setenv("VLAFUZZ_CACHE", str(tmp_path))
    typed(capsys, f"doctor --world {MODULE}:Expert")
    assert "is new here" not in first_run(tmp_path, capsys, f"{MODULE}:Expert")


def test_all_tasks_of_a_world_are_one_command_and_one_store(tmp_path: Path, capsys):
    first_run(tmp_path, capsys, f"{MODULE}:TwoTasks", "--task", "all", "--unchecked")
    tasks = [run.task for run in StoredResults(tmp_path / "a.db").runs()]
    assert tasks == [f"{MODULE}:TwoTasks/reach", f"{MODULE}:TwoTasks/again"]
