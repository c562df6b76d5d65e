import csv
import io
import json
from pathlib import Path

import pytest

from vlafuzz.cli import main
from vlafuzz.worlds.manipulation.operators import EXTRAS
from vlafuzz.worlds.tabletop.objects import load_catalogue
from vlafuzz.worlds.tabletop.space import OPERATORS


def test_operators_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["list", "operators", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert [row["operator"] for row in rows] == list(OPERATORS)
    assert {row["operator"] for row in rows if row["varies"] == "no"} == {"wording", *EXTRAS}
    assert rows[7]["range"] == "× 0.05 to 20, log-uniform"


def test_operators_of_a_task_where_they_differ(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["list", "operators", "--operators", "paper", "--task", "put-in", "--csv"]) == 0
    rows = list(csv.DictReader(io.StringIO(capsys.readouterr().out)))
    assert rows[1]["range"] == "x -0.075 to 0.025 m, y -0.07 to 0.03 m"
    assert main(["list", "operators", "--operators", "paper"]) == 0
    assert "ranges differ in put-in, put-on: --task shows them" in capsys.readouterr().err


def test_an_unknown_file_of_operators(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["list", "operators", "--operators", "papper"]) == 2
    assert "hint: did you mean 'paper'?" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("names", "flags", "says"),
    [
        ("names: [green_cub]", [], "no object 'green_cub'"),
        ("onto: [apple]", ["--task", "put-in"], "onto: 'apple' is of no use there"),
    ],
)
def test_an_object_that_a_run_refuses_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], names: str, flags: list[str], says: str
) -> None:
    (tmp_path / "mine.yaml").write_text(f"extends: tabletop\noperators:\n  target-type: {{{names}}}\n")
    assert main(["list", "operators", "--operators", str(tmp_path / "mine.yaml"), *flags]) == 2
    assert says in capsys.readouterr().err


def test_objects_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["list", "objects", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert [row["object"] for row in rows] == list(load_catalogue().names())
    can = next(row for row in rows if row["object"] == "coke_can")
    assert can["rest poses"] == {
        "standing": pytest.approx(0.065, abs=1e-3),
        "lying": pytest.approx(0.065, abs=1e-3),
    }


def test_a_table_shows_the_narrowest_grasp(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["list", "objects"]) == 0
    assert "standing 6.5 cm, lying 6.5 cm" in capsys.readouterr().out


def test_json_and_csv_exclude_each_other(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["list", "objects", "--json", "--csv"]) == 2
    assert "exclude each other" in capsys.readouterr().err


def test_policies_are_listed(capsys: pytest.CaptureFixture[str]):
    assert main(["list", "policies", "--json"]) == 0
    assert "pinhole" in [row["policy"] for row in json.loads(capsys.readouterr().out)]


def test_the_default_strategy_comes_first(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["list", "strategies"]) == 0
    assert "causes (default)" in capsys.readouterr().out.splitlines()[4]
    assert main(["list", "strategies", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)[0]["strategy"] == "causes"
