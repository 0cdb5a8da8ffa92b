"""Pictures are written whole or not at all."""

from pathlib import Path
from unittest.mock import Mock
from xml.etree import ElementTree

import pytest
from drawn_figures import figure
from matplotlib.figure import Figure

import cdpr_sim as cdpr
from cdpr_sim.drawing import maps
from cdpr_sim.studies import gallery


@pytest.fixture
def two_pictures(monkeypatch):
    """Two pictures that cost nothing, in place of the catalogue's."""
    small = gallery.Picture("", "", lambda: Figure(figsize=(2, 1)), lambda drawn: drawn)
    monkeypatch.setattr(gallery, "PICTURES", {"first": small, "second": small})


def everything(folder: Path) -> dict[str, bytes]:
    """All files in the folder, hidden ones too."""
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_each_picture_becomes_an_svg_and_a_png(two_pictures, tmp_path):
    """Both open as what they are, and nothing else is left."""
    done: list[float] = []
    folder = tmp_path / "new" / "folder"
    written = gallery.write_figures(["first", "second"], folder, progress=done.append)
    assert written == {name: [folder / f"{name}.{kind}" for kind in gallery.KINDS] for name in ("first", "second")}
    assert done == [0.5, 1.0]
    files = everything(folder)
    assert set(files) == {"first.svg", "first.png", "second.svg", "second.png"}
    assert ElementTree.fromstring(files["first.svg"]).tag.endswith("svg")
    assert files["first.png"].startswith(b"\x89PNG")


def test_existing_files_are_replaced_only_when_asked_for(two_pictures, tmp_path):
    """And that is found out before anything is computed or written."""
    (tmp_path / "second.png").write_text("mine")
    with pytest.raises(cdpr.InvalidInput, match=r"second\.png: exists, expected a new place or --force"):
        gallery.write_figures(["first", "second"], tmp_path)
    assert everything(tmp_path) == {"second.png": b"mine"}
    gallery.write_figures(["first", "second"], tmp_path, force=True)
    assert (tmp_path / "second.png").read_bytes() != b"mine"


@pytest.mark.parametrize("failing", ["study", "second file", "map"])
def test_a_failure_leaves_what_was_there(failing, two_pictures, tmp_path, monkeypatch):
    """A study that fails, or a disk that fills up: no half picture, no stray file, the old ones untouched."""
    for kind in gallery.KINDS:
        (tmp_path / f"first.{kind}").write_text("mine")
    written, write_bytes = [], Path.write_bytes

    def full(path, content):
        written.append(path)
        if len(written) == 2:
            raise OSError(28, "No space left on device")
        return write_bytes(path, content)

    def fails(*_, **__):
        raise cdpr.NotConverged("no rest") if failing == "study" else OSError(28, "No space left on device")

    def write() -> object:
        if failing != "map":
            return gallery.write_figures(["first"], tmp_path, force=True)
        return maps.write(Mock(savefig=fails), tmp_path / "first.png")

    if failing == "second file":
        monkeypatch.setattr(Path, "write_bytes", full)
    elif failing == "study":
        monkeypatch.setitem(gallery.PICTURES, "first", gallery.Picture("", "", fails, figure))
    with pytest.raises(cdpr.NotConverged if failing == "study" else cdpr.StoreError):
        write()
    assert everything(tmp_path) == {"first.svg": b"mine", "first.png": b"mine"}


def test_a_map_is_written_as_its_name_says(tmp_path):
    """Each kind opens as what it is."""
    starts = {".png": b"\x89PNG", ".svg": b"<?xml", ".pdf": b"%PDF"}
    for suffix in maps.SUFFIXES:
        maps.write(Figure(figsize=(2, 1)), tmp_path / f"map{suffix}")
        assert (tmp_path / f"map{suffix}").read_bytes().startswith(starts[suffix])


def test_every_picture_says_what_it_shows():
    """For the table of `cdpr-sim figures --list`; all figures of the paper with results are there, and say so."""
    assert all(picture.shows for picture in gallery.PICTURES.values())
    redrawn = {picture.paper: name for name, picture in gallery.PICTURES.items()}
    assert {f"Fig. {n}" for n in (3, 4, 7, 8, 9, 10, 11, 12)} <= redrawn.keys()
    for paper in ("Fig. 6", "Fig. 7", "Fig. 10"):
        caption = figure(redrawn[paper]).get_supxlabel().replace("\n", " ")
        assert caption.endswith(f"(Paper, {paper})")
