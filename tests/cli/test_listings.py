from pathlib import Path

import pytest

from tests.cli.typed import told, typed
from vlafuzz.worlds.manipulation.extras import EXTRAS
from vlafuzz.worlds.manipulation.operators import OPERATORS
from vlafuzz.worlds.tabletop.objects import load_catalogue


def test_operators_are_listed(capsys):
    rows = told(capsys, ["list", "operators", "--json"])
    assert [row["operator"] for row in rows] == list(OPERATORS)
    assert {row["operator"] for row in rows if row["varies"] == "no"} == {"wording", *EXTRAS}
    assert rows[7]["range"] == "× 0.05 to 20, log-uniform"


def test_operators_of_a_task_where_they_differ(capsys):
    rows = told(capsys, "list operators --operators paper --task put-in --json")
    assert rows[1]["range"] == "x -0.075 to 0.025 m, y -0.07 to 0.03 m"
    assert "ranges differ in put-in, put-on: --task shows them" in typed(capsys, "list operators --operators paper").err


@pytest.mark.libero
def test_operators_of_a_task_are_those_of_its_world(capsys):
    rows = told(capsys, "list operators --task libero_object/0 --json")
    assert "bystander-position" in {row["operator"] for row in rows if row["varies"] == "yes"}


def test_an_unknown_file_of_operators(capsys):
    assert "hint: did you mean 'paper'?" in typed(capsys, "list operators --operators papper", code=2).err


@pytest.mark.parametrize(
    ("names", "flags", "says"),
    [
        ("names: [green_cub]", ["--task", "pick-up"], "names: 'green_cub' is not in the catalogue"),
        ("names: [plate]", ["--task", "pick-up"], "names: 'plate' is of no use there"),
        ("onto: [apple]", ["--task", "put-in"], "onto: 'apple' is of no use there"),
    ],
)
def test_an_object_that_a_run_refuses_is_refused(tmp_path: Path, capsys, names: str, flags: list[str], says: str):
    (tmp_path / "mine.yaml").write_text(f"extends: tabletop\noperators:\n  target-type: {{{names}}}\n")
    assert says in typed(capsys, ["list", "operators", "--operators", str(tmp_path / "mine.yaml"), *flags], code=2).err


def test_objects_are_listed_with_the_narrowest_grasp_in_each_rest_pose(capsys):
    rows = told(capsys, ["list", "objects", "--json"])
    assert [row["object"] for row in rows] == list(load_catalogue().names())
    can = next(row for row in rows if row["object"] == "coke_can")
    assert can["rest poses"] == {"standing": pytest.approx(0.065, abs=1e-3), "lying": pytest.approx(0.065, abs=1e-3)}
    assert "standing 6.5 cm, lying 6.5 cm" in typed(capsys, ["list", "objects"]).out


def test_policies_and_strategies_are_listed_the_default_strategy_first(capsys):
    assert "pinhole" in [row["policy"] for row in told(capsys, ["list", "policies", "--json"])]
    assert "causes (default)" in typed(capsys, ["list", "strategies"]).out.splitlines()[4]
    assert told(capsys, ["list", "strategies", "--json"])[0]["strategy"] == "causes"
