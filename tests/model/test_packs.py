from dataclasses import replace
from pathlib import Path

import pytest

from tests.doubles import manifest
from tests.packs import can, write_pack
from vlafuzz.common import assets
from vlafuzz.worlds.tabletop.objects import open_packs
from vlafuzz.worlds.tabletop.objects.catalogue import packs_json, stored_catalogue


def test_robots_that_lie_beside_a_stores_packs_are_found_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(assets.FOLDERS, "")
    (tmp_path / "robots").mkdir()
    (tmp_path / "mine").mkdir()
    packs = open_packs(str(write_pack(tmp_path / "mine", can=can())))
    assert assets.find("robots") is None
    found = stored_catalogue(replace(manifest(), packs=packs_json(packs)))
    assert [pack.digest for pack in found.packs] == [pack.digest for pack in packs]
    assert assets.find("robots") == tmp_path / "robots"
