"""Outputs: files are written whole or not at all; devices and pipes are written in place."""

import os
import stat
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from threading import Thread

import cv2
import numpy as np
import pytest

from vlafuzz.common import assets
from vlafuzz.common.assets import kept
from vlafuzz.common.files import replacing, write_whole, writing
from vlafuzz.errors import PrerequisiteError, UsageError
from vlafuzz.model.scene_lines import write_scenes
from vlafuzz.report.page import check_place, write_page
from vlafuzz.worlds.recording import Recording, to_mp4, write_picture

PICTURE = np.zeros((32, 32, 3), dtype=np.uint8)


def write_a_page(path: Path) -> None:
    check_place(path)
    write_page(path, "<html>")


def write_film(path: Path) -> None:
    film = Recording()
    film.frames = [PICTURE] * 2
    film.write_video(path, hz=5)


WRITERS: dict[str, Callable[[Path], None]] = {
    "scenes": lambda path: write_scenes(path, []),
    "page": write_a_page,
    "picture": lambda path: write_picture(path, PICTURE),
    "film": write_film,
}


@pytest.fixture
def pipe(tmp_path: Path) -> Path:
    os.mkfifo(tmp_path / "pipe")
    return tmp_path / "pipe"


@pytest.mark.parametrize("name", WRITERS)
def test_every_writer_writes_into_a_pipe_instead_of_replacing_it(name: str, tmp_path: Path, pipe: Path):
    """As root, ``--out /dev/null`` would otherwise replace the machine's device by a file."""
    read: list[bytes] = []
    link = tmp_path / "link"
    link.symlink_to(pipe)
    reader = Thread(target=lambda: read.append(pipe.read_bytes()), daemon=True)
    reader.start()
    WRITERS[name](link)
    assert stat.S_ISFIFO(pipe.stat().st_mode)
    WRITERS[name](tmp_path / "file")  # not before the pipe: it would hang for want of a reader
    reader.join(10)
    assert len(read[0]) == (tmp_path / "file").stat().st_size
    assert {path.name for path in tmp_path.iterdir()} == {"pipe", "link", "file"}


def test_what_a_link_leads_to_is_replaced_and_the_link_stays(tmp_path: Path):
    (tmp_path / "link").symlink_to("file")
    write_whole(tmp_path / "link", "first")
    write_whole(tmp_path / "link", "second")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "file").read_text() == "second"


def test_a_write_that_fails_leaves_the_old_file_and_nothing_else(tmp_path: Path):
    write_whole(tmp_path / "film.mp4", b"old")
    with suppress(ValueError), replacing(tmp_path / "film.mp4") as unfinished:
        unfinished.write_bytes(b"half")
        raise ValueError("no such codec")
    assert [path.read_bytes() for path in tmp_path.iterdir()] == [b"old"]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_a_full_disk_is_one_sentence():
    path = Path("/dev/full")
    with pytest.raises(UsageError, match="/dev/full: cannot be written: no space left"), writing(path):
        write_whole(path, "text")


def test_a_picture_is_a_picture(tmp_path: Path):
    write_picture(tmp_path / "seen", PICTURE)
    assert cv2.imread(str(tmp_path / "seen")).shape == PICTURE.shape


def test_a_film_is_as_wide_as_its_pictures(tmp_path: Path, capfd):
    (tmp_path / "f.mp4").write_bytes(to_mp4([np.zeros((224, 300, 3), np.uint8)] * 3, 6))
    assert cv2.VideoCapture(str(tmp_path / "f.mp4")).get(cv2.CAP_PROP_FRAME_WIDTH) == 300
    assert "WARNING" not in capfd.readouterr().err


def test_a_cache_that_cannot_be_written_is_one_sentence(tmp_path: Path, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setenv("VLAFUZZ_CACHE", str(tmp_path / "file"))
    with pytest.raises(PrerequisiteError, match=r"the cache .*/file/meshes cannot be written") as caught:
        assets.made_once("meshes/can", lambda folder: None, lambda folder: False)
    assert "VLAFUZZ_CACHE" in str(caught.value.hint)
    assert kept("answer", lambda: 42) == 42  # which needs no cache


def test_what_a_killed_process_left_is_made_anew(tmp_path: Path, monkeypatch):
    monkeypatch.setenv("VLAFUZZ_CACHE", str(tmp_path))
    (tmp_path / "meshes" / ".can" / "half").mkdir(parents=True)
    assets.made_once("meshes/can", lambda folder: None, lambda folder: False)
    assert list((tmp_path / "meshes" / "can").iterdir()) == []
