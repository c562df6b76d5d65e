from pathlib import Path

import pytest
import yaml

from vlafuzz.common.assets import operators_dir
from vlafuzz.errors import CatalogueError, UsageError
from vlafuzz.worlds.manipulation.extras import EXTRAS
from vlafuzz.worlds.manipulation.operators import OPERATORS, ConfounderPosition, Light
from vlafuzz.worlds.tabletop.space import load_operators

SHIPPED = ("tabletop", "paper", "paper-rq1")
THE_TEN = set(OPERATORS) - {"wording"} - EXTRAS


def write(folder: Path, text: str) -> Path:
    path = folder / "mine.yaml"
    path.write_text(text)
    return path


def test_every_operator_in_yaml_has_code_and_the_other_way_round() -> None:
    for name in SHIPPED:
        raw = yaml.safe_load((operators_dir() / f"{name}.yaml").read_text())
        assert set(raw.get("operators", {})) <= set(OPERATORS)
    raw = yaml.safe_load((operators_dir() / "tabletop.yaml").read_text())
    assert list(raw["operators"]) == list(OPERATORS)


def test_every_operator_has_a_row_in_the_readme() -> None:
    text = (operators_dir() / "README.md").read_text()
    assert [name for name in OPERATORS if f"| `{name}` |" not in text] == []


def test_the_default_varies_the_ten_and_keeps_a_distance_of_15_cm() -> None:
    operators = load_operators()
    assert operators.varied == THE_TEN
    assert operators.min_distance == 0.15
    assert load_operators("tabletop").digest == operators.digest


@pytest.mark.parametrize(
    ("name", "digest"),
    [
        ("tabletop", "1b37cf9577053901f52819184c56db36"),
        ("paper", "d11f5a9c1e26c5e8118971c41cd2fff1"),
        ("paper-rq1", "c276081f52385d08a588c2568007fc94"),
        ("libero-max", "eca15b09fafeeea822ebac87547b5f8f"),
        ("google", "4cc3d97afbd736b0580fafe49d0b8718"),
        ("widowx", "6c1df0671fbeef5eb24e577647371b1c"),
    ],
)
def test_shipped_sets_keep_their_digests_so_that_stores_can_be_resumed(name: str, digest: str) -> None:
    assert load_operators(name).digest == digest


def test_confounders_cannot_vary_where_there_are_none() -> None:
    with pytest.raises(UsageError, match="confounder-position: there is no confounder to vary"):
        load_operators().only(["confounder-position"])
    assert load_operators().only(["confounder-position", "confounder-count"])


def test_a_file_extends_another_and_keeps_the_keys_it_leaves_out(tmp_path: Path) -> None:
    changes = "operators: {light: {spread: even}}\ntasks: {put-in: {min_distance: 0.1}}"
    mine = load_operators(write(tmp_path, f"extends: paper\n{changes}"))
    assert mine.get(Light).spread == "even"
    assert mine.get(Light).intensity == load_operators().get(Light).intensity
    assert (mine.min_distance, mine.in_task("put-in").min_distance) == (0.15, 0.1)
    assert mine.in_task("put-in").get(Light).spread == "even"
    theirs = load_operators("paper").in_task("put-in").get(ConfounderPosition)
    assert mine.in_task("put-in").get(ConfounderPosition) == theirs


def test_bounds_of_visibility_are_inherited_key_by_key_and_can_be_left_out(tmp_path: Path) -> None:
    shipped = load_operators().visible
    assert shipped is not None
    tasks = "tasks: {put-in: {visible: false}, put-on: {visible: {area: 0.1}}}"
    mine = load_operators(write(tmp_path, f"extends: tabletop\nvisible: {{apart: 20}}\n{tasks}"))
    assert mine.visible == shipped.model_copy(update={"apart": 20})
    assert mine.in_task("put-in").visible is None
    assert mine.in_task("put-on").visible == shipped.model_copy(update={"apart": 20, "area": 0.1})
    assert load_operators("google").visible == load_operators("widowx").visible == shipped
    assert load_operators("paper").visible is None
    assert load_operators("paper-rq1").in_task("put-in").visible is None


WRONG_RANGES = [
    (
        "target-position: {x: {low: 0, high: 1, stepp: 1}}",
        "target-position.x.stepp: unknown key",
        "did you mean 'step'?",
    ),
    ("light: {intensity: {low: 3, high: 2, step: 0.05, nominal: 1}}", "light.intensity: low is above high: 3 > 2", ""),
    ("light: {intensity: {low: 2, high: 3, step: 0.05, nominal: 1}}", "nominal 1 is not between 2 and 3", ""),
    ("confounder-count: {high: '3'}", "confounder-count.high: input should be a valid integer, got '3'", ""),
    ("target-position: {nominal: [[0, 0]]}", "target-position: nominal has 1 places, 2 are needed", ""),
    ("target-position: {nominal: [[0, 0], [0, 9]]}", "the nominal place (0, 9) is outside its box", ""),
]


@pytest.mark.parametrize(
    ("text", "says", "hint"),
    [
        ("min_distance: 0.1\noperators: {light: {}}", "operators.target-type: missing", "extends"),
        ("operators: {light: {}}", "min_distance: missing", "extends"),
        ("visible: {apat: 9}", "visible.apat: unknown key", "did you mean 'apart'?"),
        ("visible: {area: 2}", "visible.area: input should be less than or equal", ""),
        ("visible: 5", "visible: input should be a valid dictionary, got 5", ""),
        ("varry: [light]", "varry: unknown key", "did you mean 'vary'?"),
        ("vary: [ligt]", "vary: unknown operator 'ligt'", "did you mean 'light'?"),
        ("vary: [confounder-type]", "vary: confounder-type: there is no confounder", "vary confounder-count"),
        ("operators: {lite: {}}", "operators.lite: unknown key", "did you mean 'light'?"),
        ("operators: {light: {intensty: 3}}", "operators.light.intensty: unknown key", "'intensity'?"),
        *((f"operators: {{{ranges}}}", says, hint) for ranges, says, hint in WRONG_RANGES),
        ("tasks: {pickup: {}}", "tasks: unknown name 'pickup'", "did you mean 'pick-up'?"),
        ("extends: tabeltop", "no file", "did you mean 'tabletop'?"),
        ("[light]", "the file: ", ""),
    ],
)
def test_a_wrong_file_is_a_sentence_with_file_and_key(tmp_path: Path, text: str, says: str, hint: str) -> None:
    whole = hint == "extends" or text.startswith(("extends", "["))
    path = write(tmp_path, text if whole else f"extends: tabletop\n{text}")
    with pytest.raises(CatalogueError) as caught:
        load_operators(path)
    assert str(tmp_path) in caught.value.message
    assert says in caught.value.message
    assert "\n" not in caught.value.message
    assert hint in (caught.value.hint or "")


def test_digests_tell_ranges_apart(tmp_path: Path) -> None:
    mine = load_operators(write(tmp_path, "extends: tabletop\nmin_distance: 0.2"))
    assert len({mine.digest, load_operators().digest, load_operators("paper").digest}) == 3
    assert load_operators().only(["light"]).digest != load_operators().digest
