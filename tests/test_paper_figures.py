"""The script of the paper's figures: all figures with results are there; files are written whole or not at all."""

from pathlib import Path
from unittest.mock import Mock
from xml.etree import ElementTree

import pytest
from drawn_figures import figure
from matplotlib.figure import Figure

import cdpr_sim as cdpr
import paper_figures
from cdpr_sim.drawing import maps


@pytest.fixture
def small(monkeypatch, tmp_path):
    """A picture that costs nothing, drawn into an empty folder."""
    monkeypatch.chdir(tmp_path)
    picture = paper_figures.Picture("", "", lambda: Figure(figsize=(2, 1)), lambda drawn: drawn)
    monkeypatch.setattr(paper_figures, "PICTURES", {"small": picture})


def everything(folder: Path) -> dict[str, bytes]:
    """All files in the folder, hidden ones too."""
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_each_picture_becomes_an_svg_and_a_png(small, capsys):
    """Both open as what they are, and nothing else is left; the script says where."""
    paper_figures.main([])
    assert capsys.readouterr().out == "figures/small.svg figures/small.png\n"
    files = everything(Path("figures"))
    assert set(files) == {"small.svg", "small.png"}
    assert ElementTree.fromstring(files["small.svg"]).tag.endswith("svg")
    assert files["small.png"].startswith(b"\x89PNG")


def test_a_picture_of_the_manual_is_also_written_there(small, monkeypatch, tmp_path):
    """Those whose command the gallery has."""
    (tmp_path / "gallery.md").write_text("python scripts/figures/paper_figures.py small\n")
    monkeypatch.setattr(paper_figures, "GALLERY", tmp_path / "gallery.md")
    monkeypatch.setattr(paper_figures, "MANUAL_FOLDER", tmp_path)
    assert paper_figures.write("small")[-1] == tmp_path / "small.png"
    assert (tmp_path / "small.png").read_bytes() == Path("figures/small.png").read_bytes()


def test_a_full_disk_leaves_what_was_there(small, monkeypatch):
    """No half picture, no stray file."""
    Path("figures").mkdir()
    Path("figures/small.svg").write_text("mine")
    written, write_bytes = [], Path.write_bytes

    def full(path, content):
        written.append(path)
        if len(written) == 2:
            raise OSError(28, "No space left on device")
        return write_bytes(path, content)

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(cdpr.StoreError):
        paper_figures.write("small")
    assert everything(Path("figures")) == {"small.svg": b"mine"}


def test_a_map_is_written_as_its_name_says_or_not_at_all(tmp_path):
    """Each kind opens as what it is; where drawing fails, the old file stays."""
    starts = {".png": b"\x89PNG", ".svg": b"<?xml", ".pdf": b"%PDF"}
    for suffix in maps.SUFFIXES:
        place = tmp_path / f"map{suffix}"
        maps.write(Figure(figsize=(2, 1)), place)
        before = everything(tmp_path)
        assert before[place.name].startswith(starts[suffix])
        with pytest.raises(cdpr.StoreError):
            maps.write(Mock(savefig=Mock(side_effect=OSError(28, "No space left on device"))), place)
        assert everything(tmp_path) == before


def test_every_picture_says_what_it_shows(capsys):
    """In the list; all figures of the paper with results are there, and say so."""
    paper_figures.main(["--list"])
    listed = capsys.readouterr().out
    assert all(name in listed and picture.shows in listed for name, picture in paper_figures.PICTURES.items())
    redrawn = {picture.paper: name for name, picture in paper_figures.PICTURES.items()}
    assert {f"Fig. {n}" for n in (3, 4, 7, 8, 9, 10, 11, 12)} <= redrawn.keys()
    for paper in ("Fig. 6", "Fig. 7", "Fig. 10"):
        caption = figure(redrawn[paper]).get_supxlabel().replace("\n", " ")
        assert caption.endswith(f"(Paper, {paper})")
