"""Coverage: the paper's own figures from its files, where they are at hand, and cells of scenes and runs."""

import csv
from dataclasses import replace
from pathlib import Path

import pytest

from tests.doubles import failed, manifest, passed, scene
from tests.report.stores import MANIFEST
from vlafuzz.lab.studies.coverage import Covered, covered, place, tracks_of_scenes, tracks_of_store
from vlafuzz.model.outcome import Outcome
from vlafuzz.model.scene import Light, Placement, Scene
from vlafuzz.store.records import Trial
from vlafuzz.store.store import Store
from vlafuzz.worlds.tabletop.objects import load_catalogue
from vlafuzz.worlds.tabletop.space import load_operators
from vlafuzz.worlds.tabletop.vlatest import Rectangle, read_vlatest

CATALOGUE, OPERATORS = load_catalogue(), load_operators()
UNIT = Rectangle(x=(0.0, 1.0), y=(0.0, 1.0))
PUBLISHED = Path(__file__).resolve().parents[3] / "published"
FILES = sorted((Path(__file__).resolve().parents[3].parent / "shared" / "vlatest" / "scenes").glob("t-*_n-1000*"))


def last(scenes: list[Scene]) -> Covered:
    (track,) = tracks_of_scenes(scenes, OPERATORS, CATALOGUE)
    return list(covered(track))[-1]


def test_a_box_has_ten_cells_along_each_side_both_ends_included() -> None:
    assert [place(x, 0.0, UNIT) for x in (0.0, 0.09, 0.11, 0.95, 1.0)] == [(0, 0), (0, 0), (1, 0), (9, 0), (9, 0)]
    assert place(0.5, 1.1, UNIT) is None
    assert place(0.5, 0.3, Rectangle(x=(0.5, 0.5), y=(0.0, 1.0))) == (0, 3)


def test_scenes_in_one_place_cover_one_cell_of_a_hundred() -> None:
    result = last([scene(), scene(light=2.0), scene(light=4.0)])
    assert (result.scenes, result.positions, result.cells, result.failures) == (3, 0.01, None, None)


def test_another_operator_far_from_nominal_is_another_site() -> None:
    assert last([scene(), scene(light=1.05)]).sites == 1
    assert last([scene(), scene(light=16.0)]).sites == 2
    assert last([scene(x=-0.2, y=-0.25), scene(x=0.12, y=0.25)]).sites == 2


def test_only_the_first_scenes_count_and_then_all() -> None:
    scenes = [scene(x=-0.2 + 0.03 * number) for number in range(9)]
    (track,) = tracks_of_scenes(scenes, OPERATORS, CATALOGUE)
    assert [(row.scenes, row.positions) for row in covered(track, (3, 100))] == [(3, 0.02), (9, 0.08)]


def test_tasks_are_told_apart() -> None:
    plate = Placement("plate", "flat", 0.0, 0.2)
    other = Scene("put-on", (*scene().targets, plate), "put green cube on plate")
    tracks = tracks_of_scenes([scene(), other, scene()], OPERATORS, CATALOGUE)
    assert [(track.task, len(track.steps)) for track in tracks] == [("pick-up", 2), ("put-on", 1)]


def test_the_first_object_of_the_list_counts_as_in_the_paper() -> None:
    turned = (1.0, 0.0, 0.0, 0.0)
    source = Placement("custom:apple", "", -0.45, 0.05, quaternion=turned, listed=1)
    target = Placement("custom:orange", "", -0.15, 0.35, quaternion=turned, listed=0)
    moved = Scene("move-near", (source, target), "move apple near orange", robot="google", frame="vlatest")
    (track,) = tracks_of_scenes([moved], OPERATORS, CATALOGUE)
    assert (track.steps[0].place, track.steps[0].site) == ((8, 8), None)


@pytest.mark.skipif(not FILES, reason="no VLATest scenes in ../shared/vlatest/scenes")
def test_the_papers_table_comes_out_exactly() -> None:
    scenes = [row for path in FILES for row in read_vlatest(path, CATALOGUE, frame="original").scenes]
    rows = [row for track in tracks_of_scenes(scenes, OPERATORS, CATALOGUE) for row in covered(track)]
    result = {(row.task, row.scenes): row.positions for row in rows}
    lines = (PUBLISHED / "coverage.csv").read_text(encoding="utf-8").splitlines()
    assert result == {(row["task"], int(row["scenes"])): float(row["share"]) for row in csv.DictReader(lines[1:])}


def test_a_run_has_cells_of_what_it_did_and_of_its_failures(tmp_path: Path) -> None:
    outcomes = [failed(), failed(), passed(), Outcome.invalid("geometry", "too close"), failed()]
    lights = [1.0, 1.0, 1.0, 1.0, 16.0]
    with Store.open(tmp_path / "a.db", "write") as store:
        run = store.begin(replace(manifest(), operators=MANIFEST.operators))
        for number, (light, outcome) in enumerate(zip(lights, outcomes, strict=True)):
            shown = replace(scene(x=0.001 * number), light=Light(light))
            store.add(run, Trial(proposal=number, scene=shown, outcome=outcome, severity=0.0))
    with Store.open(tmp_path / "a.db") as store:
        (track,) = tracks_of_store(store)
    (result,) = covered(track)
    assert (result.scenes, result.sites, result.cells, result.failures) == (4, 2, 3, 2)
