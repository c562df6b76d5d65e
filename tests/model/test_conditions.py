"""Conditions: what decides an outcome is declared once, and keys stay what they were."""

import json
from dataclasses import fields, replace

import pytest

from tests.doubles import manifest
from vlafuzz.errors import UsageError
from vlafuzz.model import Conditions, Setting
from vlafuzz.model.conditions import ASKED, Origin, Role, as_kept, from_kept
from vlafuzz.rollouts.policies import make_policy
from vlafuzz.store.records import Manifest
from vlafuzz.worlds.provenance import described

BEGUN = Conditions(
    task="pick-up",
    policy="mini",
    spec='{"name": "mini"}',
    seed=3,
    world={"min_distance": 0.15},
    catalogue_digest="c" * 16,
    simulator="vlafuzz 0.1.0/mani_skill 3.0.1/sapien 3.0.3",
    commit="0" * 40,
)
OWN = {"policy": "python:mine:make", "source": "abc123"}


def packs(folder: str, digest: str = "d") -> str:
    return json.dumps([{"name": "cups", "digest": digest, "folder": folder}])


def scenes(flag: str, digest: str) -> str:
    return json.dumps({"flag": flag, "file": "/a/b.jsonl", "digest": digest})


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({}, "mini:ac61f15bf582"),
        ({"commit": None}, "mini:8ca4c7e1bcea"),
        (
            {"repeats": 5, "criteria": "published", "stop_early": True}
            | {"world": {"min_distance": 0.15, "placement": "published"}},
            "mini:3db387351770",
        ),
        (OWN, "python:mine:make:368bbde6cb5b"),
        ({"seed": 4}, "mini:8e7a219953f7"),
    ],
)
def test_keys_are_those_of_the_stores_that_there_are(changes, key):
    assert replace(BEGUN, **changes).key() == key


def test_the_spec_of_a_policy_without_calibration_is_stored_as_it_always_was():
    assert "calibrated" not in described(make_policy("pinhole").spec)
    assert json.loads(described(make_policy("seeing").spec))["calibrated"] is True


@pytest.mark.parametrize(
    "change", [{"task": "put-on"}, {"robot": "widowx"}, {"operators_digest": "o"}, {"packs": packs("a")}]
)
def test_what_only_says_which_scenes_there_are_is_not_in_a_key(change):
    assert replace(BEGUN, **change).key() == BEGUN.key()


def test_a_key_without_the_seed_is_shared_by_repetitions_and_nothing_else():
    assert replace(BEGUN, seed=9).key(seeded=False) == BEGUN.key(seeded=False)
    assert replace(BEGUN, repeats=2).key(seeded=False) != BEGUN.key(seeded=False)


def test_a_key_without_bounds_of_visibility_is_as_old_as_before_them():
    bounded = replace(BEGUN, world={"min_distance": 0.15, "visible": "{}"})
    assert bounded.key() == "mini:6679afdd2f01"
    assert bounded.without("visible").key() == replace(bounded, world=bounded.world | {"visible": ""}).key()
    assert bounded.without("visible").key() == BEGUN.key()


def test_settings_of_a_world_are_in_keys_and_differ_by_name():
    set_, default = Setting("friction", "dry", ("dry", "wet")), BEGUN
    wet = replace(BEGUN, world={**BEGUN.world, "friction": "wet"})
    assert (set_.of(default), set_.of(wet), default.value("friction")) == ("dry", "wet", None)
    assert wet.key() != default.key()
    assert default.differences(wet) == default.differences(wet, origins=ASKED) == ("friction",)
    assert default.differences(wet, origins=[Origin.HERE]) == ()
    assert not default.comparable(wet)


def test_files_keep_the_settings_of_before_among_the_fields_and_others_apart():
    kept = as_kept(replace(BEGUN, world={"min_distance": 0.15, "friction": "wet"}))
    assert (kept["placement"], kept["min_distance"], kept["visible"]) == ("resting", 0.15, "")
    assert kept["world"] == {"friction": "wet"}
    assert "world" not in as_kept(BEGUN)
    for conditions in (BEGUN, Conditions(**from_kept(kept))):
        assert Conditions(**from_kept(as_kept(conditions))) == conditions


def test_differences_are_named_by_where_their_values_come_from():
    other = replace(BEGUN, robot="google", seed=4, world={"min_distance": 0.1}, commit="1")
    assert BEGUN.differences(other) == ("robot", "seed", "min_distance", "commit")
    assert BEGUN.differences(other, origins=ASKED) == ("robot", "seed", "min_distance")
    assert BEGUN.differences(other, roles=[Role.SIMULATION]) == ("min_distance", "commit")
    assert BEGUN.differences(other, origins=[Origin.HERE]) == ("commit",)


def test_packs_are_compared_by_what_is_in_them_and_a_file_of_scenes_only_as_a_pool():
    moved = replace(BEGUN, packs=packs("a")).differences(replace(BEGUN, packs=packs("b")))
    changed = replace(BEGUN, packs=packs("a")).differences(replace(BEGUN, packs=packs("a", "e")))
    assert (moved, changed) == ((), ("packs",))
    pool = replace(BEGUN, scene_file=scenes("pool", "x"))
    assert pool.differences(replace(BEGUN, scene_file=scenes("pool", "y"))) == ("scene_file",)
    assert BEGUN.differences(replace(BEGUN, scene_file=scenes("scenes", "x"))) == ()


def test_runs_compare_when_only_search_and_seed_differ():
    assert manifest(strategy="nsga2", budget=9, batch=2, seed=5).comparable(manifest())
    assert not manifest(robot="widowx").comparable(manifest())
    assert not manifest(source="x").comparable(manifest())


def test_every_field_has_a_role_but_those_that_decide_nothing():
    without = {field.name for field in fields(Manifest) if "role" not in field.metadata}
    assert without == {"operators", "versions", "command", "checkup"}


def test_criteria_that_no_simulator_knows_are_refused():
    with pytest.raises(UsageError, match="unknown criteria 'weak'"):
        replace(BEGUN, criteria="weak")
