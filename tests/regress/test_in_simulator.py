"""Two subjects whose result is known, in the real simulator."""

from dataclasses import replace
from pathlib import Path

from tests.corpus.bundles import bundle, case
from tests.doubles import manifest
from vlafuzz.cli import main
from vlafuzz.corpus.folder import write_bundle
from vlafuzz.corpus.ranges import operators_json
from vlafuzz.space import load_operators


def corpus(folder: Path) -> None:
    """Failures of ``frozen``, which passes nothing; controls are recorded as failed, too."""
    run = manifest(subject="frozen", operators=operators_json(load_operators()))
    cases = [replace(case(number), counterparts={}, nominal_passes=False) for number in range(7)]
    write_bundle(replace(bundle(*cases), runs=[run]), folder)


def test_frozen_is_worse_than_the_expert_and_not_worse_than_itself(tmp_path: Path, capsys):
    corpus(tmp_path / "a")
    arguments = ["regress", str(tmp_path / "a"), "--subject"]
    assert main([*arguments, "frozen", "--baseline", "expert"]) == 1
    assert main([*arguments, "frozen"]) == 0
    assert main([*arguments, "expert", "--baseline", "frozen"]) == 0
    assert "frozen is worse than expert: 7 worse and 0 better of 7 pairs" in capsys.readouterr().out
