"""Near-copies of one failure share a card of the gallery."""

from dataclasses import replace
from pathlib import Path

from tests.cli.typed import typed
from tests.doubles import ended
from tests.failures.triage.planted import SPACE
from tests.report.stores import MANIFEST, view
from vlafuzz.model.scene import Scene
from vlafuzz.store.records import Attribution, FoundCause
from vlafuzz.store.store import Store

NOMINAL = SPACE.nominal()
DARK = replace(NOMINAL, light=replace(NOMINAL.light, intensity=0.1))
TILTED = replace(NOMINAL, camera=replace(NOMINAL.camera, pitch=4.0))
DARK_TOO = replace(DARK, camera=TILTED.camera)  # adds an operator to the dark one, as to the tilted one
HARDLY_TILTED = replace(NOMINAL, camera=replace(NOMINAL.camera, pitch=4.2))


def kept(path: Path, *scenes: Scene, cause: Scene | None = None) -> Path:
    with Store.open(path, "write") as store:
        run = store.begin(MANIFEST)
        for number, scene in enumerate(scenes):
            store.add(run, ended(scene, proposal=number))
        if cause:
            store.keep_causes(run, Attribution((FoundCause(cause, ("light",), 1),)))
        store.finish(run, "finished", 1.0)
    return path


def shown(path: Path) -> dict[Scene, tuple[str, ...]]:
    return {card.of.scene: card.of.alike for card in view(path).cards}


def test_a_near_copy_is_counted_beside_the_first(tmp_path: Path):
    found = shown(kept(tmp_path / "a.db", DARK, TILTED, HARDLY_TILTED))
    assert found == {DARK: (), TILTED: (HARDLY_TILTED.digest,)}


def test_a_failure_stands_for_those_that_only_add_operators(tmp_path: Path):
    assert shown(kept(tmp_path / "a.db", DARK_TOO, DARK)) == {DARK: (DARK_TOO.digest,)}


def test_the_nominal_scene_stands_for_itself_alone(tmp_path: Path):
    assert shown(kept(tmp_path / "a.db", DARK, NOMINAL)) == {DARK: (), NOMINAL: ()}


def test_what_shows_a_cause_keeps_its_card_and_comes_first(tmp_path: Path):
    path = kept(tmp_path / "a.db", TILTED, DARK, DARK_TOO, cause=DARK_TOO)
    assert list(shown(path)) == [DARK_TOO, TILTED, DARK]


def test_the_list_counts_them_and_json_has_all(tmp_path: Path, capsys):
    path = kept(tmp_path / "a.db", DARK, TILTED, HARDLY_TILTED)
    printed = typed(capsys, ["report", str(path)]).out
    assert "3 failures, 1 of them like another, the strongest causes first" in printed
    assert "1 more alike" in printed
    assert typed(capsys, ["report", str(path), "--json"]).out.count('"found"') == 3
