"""Pictures are written whole or not at all."""

from pathlib import Path
from xml.etree import ElementTree

import pytest
from matplotlib.figure import Figure

import cdpr_sim as cdpr
from cdpr_sim.studies import gallery


def small() -> Figure:
    figure = Figure(figsize=(2, 1))
    figure.suptitle("a small picture")
    return figure


@pytest.fixture
def two_pictures(monkeypatch):
    """Two pictures that cost nothing, in place of the catalogue's."""
    pictures = {name: gallery.Picture("", "", lambda: None, lambda _: small()) for name in ("first", "second")}
    monkeypatch.setattr(gallery, "PICTURES", pictures)
    return pictures


def everything(folder: Path) -> dict[str, bytes]:
    """All files in the folder, hidden ones too."""
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_each_picture_becomes_an_svg_and_a_png(two_pictures, tmp_path):
    """Both open as what they are, and nothing else is left."""
    done: list[float] = []
    folder = tmp_path / "new" / "folder"
    written = gallery.write_figures(list(two_pictures), folder, progress=done.append)
    assert written == {name: [folder / f"{name}.{kind}" for kind in gallery.KINDS] for name in two_pictures}
    assert done == [0.5, 1.0]
    files = everything(folder)
    assert set(files) == {"first.svg", "first.png", "second.svg", "second.png"}
    assert ElementTree.fromstring(files["first.svg"]).tag.endswith("svg")
    assert files["first.png"].startswith(b"\x89PNG")


def test_existing_files_are_replaced_only_when_asked_for(two_pictures, tmp_path):
    """And that is found out before anything is computed or written."""
    (tmp_path / "second.png").write_text("mine")
    with pytest.raises(cdpr.InvalidInput, match=r"second\.png: exists, expected a new place or --force"):
        gallery.write_figures(list(two_pictures), tmp_path)
    assert everything(tmp_path) == {"second.png": b"mine"}
    gallery.write_figures(list(two_pictures), tmp_path, force=True)
    assert (tmp_path / "second.png").read_bytes() != b"mine"


@pytest.mark.parametrize("failing", ["study", "second file"])
def test_a_failure_leaves_what_was_there(failing, two_pictures, tmp_path, monkeypatch):
    """A study that fails, or a disk that fills up: no half picture, no stray file, the old ones untouched."""
    for kind in gallery.KINDS:
        (tmp_path / f"first.{kind}").write_text("mine")
    if failing == "study":

        def study():
            raise cdpr.NotConverged("no rest")

        monkeypatch.setitem(two_pictures, "first", gallery.Picture("", "", study, lambda _: small()))
        error = cdpr.NotConverged
    else:
        write_bytes = Path.write_bytes
        written = []

        def full(path, content):
            written.append(path)
            if len(written) == 2:
                raise OSError(28, "No space left on device")
            return write_bytes(path, content)

        monkeypatch.setattr(Path, "write_bytes", full)
        error = cdpr.StoreError
    with pytest.raises(error):
        gallery.write_figures(["first"], tmp_path, force=True)
    assert everything(tmp_path) == {"first.svg": b"mine", "first.png": b"mine"}


def test_unknown_name_or_place_is_refused_before_anything_is_computed(monkeypatch, tmp_path):
    """One sentence, with the nearest name; no picture is started."""
    monkeypatch.setattr(gallery.Picture, "figure", lambda self: pytest.fail("computed"))
    with pytest.raises(cdpr.UnknownName, match="unknown figure 'paperline': did you mean paper-line"):
        gallery.write_figures(["agreement", "paperline"], tmp_path)
    for name in ("Fig. 10", "figure 10"):
        with pytest.raises(cdpr.UnknownName, match=f"unknown figure '{name}': did you mean cogiro\\? known: agreement"):
            gallery.write_figures([name], tmp_path)
    with pytest.raises(cdpr.UnknownName, match=r"unknown figure 'Fig\. 1': known: agreement"):
        gallery.write_figures(["Fig. 1"], tmp_path)
    with pytest.raises(cdpr.UnknownName, match="unknown kind of file 'pgn': did you mean png"):
        gallery.write_figures(["agreement"], tmp_path, kinds=["pgn"])
    (tmp_path / "taken").write_text("mine")
    with pytest.raises(cdpr.InvalidInput, match=r"taken.*: cannot be written"):
        gallery.write_figures(["agreement"], tmp_path / "taken" / "in")
    assert everything(tmp_path) == {"taken": b"mine"}


def test_every_picture_says_what_it_shows():
    """For the table of `cdpr-sim figures --list`; all figures of the paper with results are there."""
    assert all(picture.shows for picture in gallery.PICTURES.values())
    redrawn = {picture.paper for picture in gallery.PICTURES.values()}
    assert {f"Fig. {n}" for n in (3, 4, 7, 8, 9, 10, 11, 12)} <= redrawn
