"""Place: two machines are told apart by what can decide an outcome, in words."""

import json

import pytest

from tests.doubles import manifest
from vlafuzz.policies.base import CameraRequest, PolicySpec
from vlafuzz.worlds.provenance import elsewhere, here, in_words
from vlafuzz.worlds.tabletop.renderer import probe_once
from vlafuzz.worlds.tabletop.world import WORLD

BLIND = PolicySpec("blind")
SEEING = PolicySpec("seeing", cameras=(CameraRequest("front", 8, 8),))
OLD = {"processor": "x86_64", "instructions": "AVX2", "torch": "2.13.0+cpu", "threads": None}
OLD |= {"renderer": "llvmpipe (256 bits), Mesa 25.0.7"}
NEW = OLD | {"instructions": "AVX512", "renderer": "NVIDIA H200, NVIDIA 580.1"}
SAID = "x86_64, AVX2, torch 2.13.0+cpu, llvmpipe (256 bits), Mesa 25.0.7"


def stored(place: dict) -> str:
    return json.dumps(place)


def test_a_difference_is_said_in_words():
    words = "AVX2 instead of AVX512, llvmpipe (256 bits), Mesa 25.0.7 instead of NVIDIA H200, NVIDIA 580.1"
    assert elsewhere(stored(OLD), stored(NEW)) == f"at another place: {words}"
    assert elsewhere(stored(OLD), stored(OLD)) == ""


def test_the_place_of_earlier_stores_is_not_known():
    assert elsewhere("", stored(NEW)) == "at a place that is not known"
    assert (elsewhere("", ""), in_words("")) == ("", "")


def test_what_a_later_version_adds_to_a_place_is_left_out():
    later = stored(OLD | {"cores": 64})
    assert in_words(later) == SAID
    assert elsewhere(later, stored(NEW)) == elsewhere(stored(OLD), stored(NEW))


def test_what_only_one_of_two_policies_depends_on_is_no_difference():
    looks_on = OLD | {"renderer": ""}
    assert elsewhere(stored(OLD), stored(looks_on)) == ""


def test_this_place_has_what_torch_uses(monkeypatch: pytest.MonkeyPatch):
    import torch

    plain = here("pinhole", BLIND, WORLD.renderer)
    assert torch.backends.cpu.get_cpu_capability() in in_words(plain)
    assert torch.__version__ in in_words(plain)
    monkeypatch.setenv("ONEDNN_MAX_CPU_ISA", "SSE41")
    assert "ONEDNN_MAX_CPU_ISA=SSE41 instead of" in elsewhere(here("pinhole", BLIND, WORLD.renderer), plain)


def test_threads_count_for_the_users_own_code_only():
    assert json.loads(here("pinhole", BLIND, WORLD.renderer))["threads"] is None
    assert json.loads(here("python:my:make", BLIND, WORLD.renderer))["threads"] >= 1
    assert json.loads(here("python:my:make", BLIND, WORLD.renderer, workers=True))["threads"] == 1


@pytest.mark.render
def test_only_for_a_policy_that_sees_the_renderer_counts():
    assert json.loads(here("pinhole", BLIND, WORLD.renderer))["renderer"] == ""
    assert json.loads(here("mini", SEEING, WORLD.renderer))["renderer"].startswith(probe_once().name)


def test_a_place_is_part_of_the_key_and_leaves_shares_comparable():
    there, not_known = manifest(place=stored(OLD)), manifest()
    assert len({run.key() for run in (there, not_known, manifest(place=stored(NEW)))}) == 3
    assert there.comparable(manifest(place=stored(NEW)))
