"""The robot file, explained: its document, its schema, the template, and how a robot looks."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from matplotlib import image
from test_cli import run

import cdpr_sim as cdpr
from cdpr_sim.drawing.still import draw, encoded
from cdpr_sim.robots import robot_file
from cdpr_sim.robots.robot_file_text import as_toml

ROOT = Path(__file__).parents[1]

KEYS = {key for table in robot_file.TABLES.values() for key in table.model_fields}

ROBOT = """
name = "mine"
{robot}
[platform]
mass = 1.5
size = [0.2, 0.1, 0.1]
{platform}
[[cables]]
exit = [0, 0, 1]
anchor = [0, 0, 0.05]
{cable}
[[cables]]
exit = [1, 0, 1]
anchor = [0.1, 0, 0.05]
"""


def loaded(tmp_path: Path, robot: str, platform: str = "", cable: str = "") -> cdpr.Robot:
    file = tmp_path / "mine.toml"
    file.write_text(ROBOT.format(robot=robot, platform=platform, cable=cable))
    return cdpr.load_robot(file)


def test_the_document_is_fresh():
    """docs/robot-file.md is what `cdpr-sim schema --document` prints, and has a line for every key with its meaning."""
    printed = run("schema", "--document").stdout
    assert (ROOT / "docs" / "robot-file.md").read_text(encoding="utf-8") == printed
    for table in robot_file.TABLES.values():
        for key, field in table.model_fields.items():
            assert re.search(rf"^\| `{key}` \| .* \| {re.escape(field.description)} \|$", printed, re.MULTILINE), key


def test_the_schema_knows_every_key_and_nothing_else():
    """As editors read it: strict tables, each key with a description."""
    schema = json.loads(run("schema").stdout)
    tables = [schema, *schema["$defs"].values()]
    assert {key for table in tables for key in table["properties"]} == KEYS
    assert all(table["additionalProperties"] is False for table in tables)
    assert all("description" in value for table in tables for value in table["properties"].values())


def test_the_template_settles_as_it_is_and_mentions_every_key(tmp_path, monkeypatch):
    """`new` writes it, and never over a file; both methods agree on it; with its comments uncommented, too."""
    monkeypatch.chdir(tmp_path)
    assert run("new", "mine").exit_code == 0
    refused = run("new", "mine")
    assert (refused.exit_code, "exists" in refused.stderr) == (2, True)
    robot = cdpr.load_robot("mine.toml")
    assert robot.name == "mine"
    assert cdpr.compare(cdpr.solve(robot, robot.home), cdpr.settle(robot, robot.home)).agrees
    text = Path("mine.toml").read_text(encoding="utf-8")
    nested = {"radius", "axis"}
    for key in KEYS - nested - {"platform", "frame", "workspace", "cables"}:
        assert re.search(rf"^#?{key} = ", text, re.MULTILINE), key
    memories, without = "pulley_friction|hysteresis|creep", "axial_stiffness|modulus|linear_density|name"
    for refused in (memories, "stiffening"):  # a rope with a memory has a linear law
        with_all = re.sub(rf"^#(?!{without}|{refused})(\w+ = )", r"\1", text, flags=re.MULTILINE)
        assert with_all != text
        Path("mine.toml").write_text(with_all)
        assert cdpr.load_robot("mine.toml").material == "my own rope"


@pytest.mark.parametrize(
    ("given", "stiffness", "name"),
    [
        ("axial_stiffness = 5e3", 5e3, None),
        ('axial_stiffness = 5e3\ncable_name = "mine"', 5e3, "mine"),
        ("modulus = 60e9\ndiameter = 0.0015", 60e9 * np.pi * 0.0015**2 / 4, None),
        ('material = "vectran-0.7mm"', 10e3, "vectran-0.7mm"),
        ('material = "dyneema"\ndiameter = 0.002', 64e9 * 0.65 * np.pi * 0.002**2 / 4, "dyneema-2mm"),
        ('material = "dyneema-2mm"', 64e9 * 0.65 * np.pi * 0.002**2 / 4, "dyneema-2mm"),
    ],
)
def test_cables_are_given_in_one_of_three_ways(tmp_path, given, stiffness, name):
    """For all of them, or for one, which then has a stiffness and a name of its own; in millimetres as well."""
    robot = loaded(tmp_path, given)
    np.testing.assert_allclose(robot.axial_stiffness, stiffness, rtol=1e-12)
    assert robot.material == name
    one = loaded(tmp_path, "axial_stiffness = 1.0", cable=given.replace("cable_name", "name"))
    np.testing.assert_allclose(one.axial_stiffness, [stiffness, 1.0], rtol=1e-12)
    assert one.material is None
    if "diameter" in given:
        millimetres = re.sub(r"diameter = (.*)", lambda found: f"diameter = {1e3 * float(found[1])}", given)
        scaled = loaded(tmp_path, f'units = "mm"\n{millimetres}')
        np.testing.assert_allclose(scaled.axial_stiffness, stiffness, rtol=1e-12)


def test_a_cable_may_have_a_diameter_of_its_own(tmp_path):
    """Of the robot's material."""
    robot = loaded(tmp_path, 'material = "dyneema"\ndiameter = 0.002', cable="diameter = 0.004")
    assert robot.axial_stiffness[0] == pytest.approx(4 * robot.axial_stiffness[1])


def test_ropes_weigh_what_makers_say(tmp_path):
    """6x19 steel rope of 4 mm: 0.400 kg/m per cm² of d² (EN 12385-4), 0.064 kg/m; and EA = 40.4 GPa d²."""
    robot = loaded(tmp_path, 'material = "steel-rope"\ndiameter = 0.004\nlinear_density = "material"')
    np.testing.assert_allclose(robot.cabling.linear_density, 0.400e4 * 0.004**2, rtol=2e-3)
    np.testing.assert_allclose(robot.axial_stiffness, 40.4e9 * 0.004**2, rtol=2e-3)
    for rope in cdpr.ROPES.values():
        assert rope.source
        assert 0 < rope.fill <= 1


def test_ropes_break_where_their_sources_say_and_nowhere_else(tmp_path):
    """6x19 steel rope, grade 1770: 0.356 d² times it; braided HMPE: 580 MN per m² of d²; without a source none."""
    robot = loaded(tmp_path, 'material = "steel-rope"\ndiameter = 0.004', cable='material = "dyneema-2mm"')
    np.testing.assert_allclose(robot.breaking_load, [580e6 * 0.002**2, 0.356 * 1770e6 * 0.004**2], rtol=1e-3)
    for name, rope in cdpr.ROPES.items():
        known = name in {"steel-rope", "dyneema", "nylon"}
        assert (rope.strength is not None) == ("breaking" in rope.source and "not known" not in rope.source) == known
        assert np.isfinite(loaded(tmp_path, f'material = "{name}-2mm"').breaking_load).all() == known
    assert {name for name, one in cdpr.MATERIALS.items() if one.breaking_load is not None} == {"nylon-0.4mm"}
    own = loaded(tmp_path, 'material = "dyneema-2mm"\nbreaking_load = 900', cable="breaking_load = 700")
    assert own.breaking_load.tolist() == [700, 900]
    with pytest.raises(cdpr.RobotFileError, match="breaking_load: found 0 N in cable 1, expected more than 0"):
        loaded(tmp_path, 'material = "dyneema-2mm"', cable="breaking_load = 0")


@pytest.mark.parametrize(
    ("robot", "platform", "cable", "message"),
    [
        ("EA = 1e4", "", "", "EA: unknown key, did you mean 'axial_stiffness'?"),
        ("axial_stiffness = 1e4", "com = [0, 0, 0]", "", "platform.com: unknown key, did you mean 'center_of_mass'?"),
        ("com = [0, 0, 0]", "", "", "com: unknown key, did you mean 'center_of_mass' in [platform]?"),
        ("exits = [[0, 0, 1]]", "", "", "exits: unknown key, did you mean 'exit' in [[cables]]?"),
        (
            "axial_stiffness = 1e4",
            "",
            "pulley_radius = 0.1",
            "pulley_radius: unknown key, did you mean 'radius' in [pulley]?",
        ),
        ("platform_size = [1, 1, 1]", "", "", "platform_size: unknown key, did you mean 'size' in [platform]?"),
        ("axial_stiffness = 1e4", "", "mobility = 'planar'", "did you mean 'mobility' for the whole robot?"),
        ("material = 'steel'", "", "", "did you mean steel-rope-2mm?"),
        ("material = 'Dyneema'", "", "", "did you mean dyneema-2mm?"),
        ("material = 'Dyneema'\ndiameter = 0.002", "", "", "unknown material 'Dyneema': did you mean dyneema?"),
        ("diameter = 0.002", "", "material = 'DYNEEMA'", "unknown material 'DYNEEMA': did you mean dyneema-2mm?"),
        ("material = 'fishing-0.4mm'\ndiameter = 0.002", "", "", "the robot: found diameter, expected none"),
        ("material = 'rope'", "", "", "or give axial_stiffness [N], or modulus [Pa] and diameter"),
        ("material = 'nylon'", "", "", "the robot: found material 'nylon' without diameter, expected both"),
        ("modulus = 60e9", "", "", "the robot: found modulus without diameter, expected both"),
        ("axial_stiffness = 1e4\ndiameter = 0.002", "", "", "the robot: found diameter, expected none"),
        ("axial_stiffness = 1e4\nmodulus = 1e9", "", "", "the robot: found both axial_stiffness and modulus"),
        ("modulus = -1\ndiameter = 0.002", "", "", "modulus: found -1 Pa, expected more than 0"),
        ("axial_stiffness = 1e4\ndiameter = 0", "", "", "the robot: found diameter, expected none"),
        ("material = 'dyneema'\ndiameter = 0", "", "", "diameter: found 0 m, expected more than 0"),
        ("axial_stiffness = 1e4\nlinear_density = 'material'", "", "", "the mass of a cable given by its stiffness is"),
        (
            "axial_stiffness = 1e4\nlinear_density = 'heavy'",
            "",
            "",
            "linear_density: found 'heavy', expected a number or 'material'",
        ),
        ("", "", "", "cable 1: found neither material nor axial_stiffness nor modulus"),
    ],
)
def test_messages_lead_on(tmp_path, robot, platform, cable, message):
    """What was meant, or what can be given instead."""
    with pytest.raises(cdpr.RobotFileError) as error:
        loaded(tmp_path, robot, platform, cable)
    assert message in str(error.value)


def test_a_single_table_of_cables_is_refused_with_the_form_that_is_meant(tmp_path):
    """TOML's [cables] is one table; a robot has several."""
    file = tmp_path / "robot.toml"
    file.write_text('name = "one"\n[platform]\nmass = 1.0\n[cables]\nexit = [0, 0, 1]\nanchor = [0, 0, 0]\n')
    with pytest.raises(cdpr.RobotFileError, match=r"cables: found .*, expected one table \[\[cables\]\] for each"):
        cdpr.load_robot(file)


def test_a_rope_on_the_command_line_has_its_diameter():
    """As ``--material`` and ``replace`` take it."""
    assert cdpr.load_robot("cogiro").replace(material="steel-rope-1.5mm").axial_stiffness[0] == pytest.approx(
        90.97e3, 1e-3
    )
    refused = run("settle", "cogiro", "--material", "steel-rope")
    assert "unknown material 'steel-rope': did you mean steel-rope-2mm?" in refused.stderr


@pytest.mark.parametrize("name", ["cogiro", "two-cable"])
def test_a_robot_is_drawn_with_its_numbers(name, tmp_path):
    """Each cable's number at its exit and at its anchor, under the robot's name; a notebook shows the figure."""
    robot = cdpr.load_robot(name)
    figure = draw(robot)
    assert figure.get_suptitle().startswith(f"{name}: ")
    for ax in figure.axes:
        numbers = [int(number) for text in ax.texts for number in text.get_text().split(", ")]
        assert sorted(numbers) == list(range(1, robot.cables + 1))
    shown = figure._repr_png_()  # type: ignore[attr-defined]
    assert shown.startswith(b"\x89PNG")
    written = tmp_path / "robot.png"
    assert run("show", name, "-o", str(written)).exit_code == 0
    assert written.read_bytes() == shown
    assert run("show", name, "-o", str(written)).exit_code == 2
    picture = image.imread(written)
    assert (picture[..., :3].min(-1) < 0.5).mean() > 0.01  # something is drawn


def test_what_is_drawn_is_the_robot():
    """Exits at one point share a label; a cable with mass is drawn straight, as it is commanded; a pose moves it."""
    robot = cdpr.load_robot("cogiro")
    pair = robot.replace(exits=robot.exits[[0, 0, 2, 3, 4, 5, 6, 7]], linear_density=1e-3)
    assert "1, 2" in [text.get_text() for text in draw(pair).axes[0].texts]
    moved, usual = (draw(robot, pose).axes[0].lines[1].get_data_3d() for pose in ((0.3, 0.2, 0.2), None))
    assert not np.array_equal(moved, usual)
    one = cdpr.Robot(exits=[[0, 0, 0]], anchors=[[0, 0, 0]], axial_stiffness=1e3, mass=1, platform_size=[1, 1, 1])
    assert encoded(draw(one.replace(name="$odd{$"), (0.5, 0, 0)))  # a frame of no size
    with pytest.raises(cdpr.InvalidInput, match="planar"):
        draw(cdpr.load_robot("two-cable"), (0.3, 0.2, 0.2))


CRANE = """
name = "crane"
material = "steel-rope-4mm"
linear_density = "material"
[platform]
mass = 20
size = [0.4, 0.4, 0.3]
""" + "".join(
    f"[[cables]]\nexit = [{3 * x}, {3 * y}, 3]\nanchor = [{0.4 * x - 0.2}, {0.4 * y - 0.2}, {z}]\n"
    for x in (0, 1) for y in (0, 1) for z in (-0.15, 0.15)
)  # fmt: skip


def test_another_material_changes_the_mass_of_cables_that_had_the_last_ones(tmp_path, monkeypatch):
    """As its designer does: `solve`, `sweep` and `show` with `--material`; a mass given by hand stays, and is noted."""
    monkeypatch.chdir(tmp_path)
    Path("crane.toml").write_text(CRANE)
    Path("rope.toml").write_text(CRANE.replace("steel-rope-4mm", "dyneema-4mm"))
    Path("hand.toml").write_text(CRANE.replace('"material"', "0.064"))
    at, words = ("--pose", "1.5", "1.5", "0.3", "--json"), ("--material", "dyneema-4mm")
    by_hand = run("solve", "hand.toml", *at, *words)
    every = run("solve", "crane.toml", *at, *words), run("solve", "rope.toml", *at), by_hand
    asked, meant, stays = (json.loads(told.stdout) for told in every)
    assert asked["position"] == meant["position"]
    assert abs(stays["position"][2] - meant["position"][2]) > 1e-4
    assert "crane: given by hand, and not changed by --material dyneema-4mm: mass per length" in " ".join(
        by_hand.stderr.split()
    )
    crane, rope = cdpr.load_robot("crane.toml"), cdpr.load_robot("rope.toml")
    both = cdpr.sweep(crane, (2, 2, 2), ["steel-rope-4mm", "dyneema-4mm"])
    for material, one in (("steel-rope-4mm", crane), ("dyneema-4mm", rope)):
        single, mine = cdpr.sweep(one, (2, 2, 2)), both.sel(material=material)
        for name in ("position", "tensions", "feasible", "linear_density"):
            np.testing.assert_array_equal(mine[name], single[name], err_msg=name)
    np.testing.assert_array_equal(
        cdpr.sweep(crane, (2, 1, 1), ["dyneema-4mm"])["linear_density"].squeeze(), rope.linear_density
    )
    mapped = run("map", "crane.toml", "--points", "5", "--material", "steel-rope-4mm", "--material", "dyneema-4mm")
    assert mapped.stdout.count("with rigid cables: static feasible workspace") == 2
    compared = cdpr.check(crane, (2, 1, 1), ["dyneema-4mm"]).dataset
    np.testing.assert_array_equal(
        compared["position_error"].squeeze(), cdpr.check(rope, (2, 1, 1)).dataset["position_error"].squeeze()
    )
    told = " ".join(run("show", "hand.toml", *words).stdout.split())
    assert "EA, breaking load of dyneema-4mm; by hand: mass per length" in told
    shown = json.loads(run("show", "crane.toml", "--force", "--json").stdout)
    assert set(shown["from_material"]) == {"axial_stiffness", "linear_density", "breaking_load"}


def test_materials_and_pretension_are_written_by_name_and_read_back(tmp_path):
    """Also where they differ from cable to cable; a copy of a catalogue robot keeps its words."""
    robot = loaded(
        tmp_path,
        'material = "dyneema-2mm"\nlinear_density = "material"\npretension = 3.5',
        cable="linear_density = 0.01",
    )
    for one in (robot, robot.replace(material="nylon-0.4mm", linear_density=0), robot.replace(axial_stiffness=5e3)):
        (tmp_path / "again.toml").write_text(as_toml(one))
        again = cdpr.load_robot(tmp_path / "again.toml")
        assert again.from_material == one.from_material
        assert (again.material, again.pretension) == (one.material, 3.5)
        assert again.cabling.same_as(one.cabling)
        np.testing.assert_array_equal(again.breaking_load, one.breaking_load)


def test_new_copies_a_robot_and_says_what_a_name_means(tmp_path, monkeypatch):
    """`--from` a name or a file; a name of the catalogue is noted, and one of nothing refused."""
    monkeypatch.chdir(tmp_path)
    assert run("new", "mine", "--from", "cogiro-crane-built").exit_code == 0
    built = cdpr.load_robot("cogiro-crane-built")
    assert cdpr.load_robot("mine.toml").cabling.same_as(built.cabling)
    assert "# kg/m: 0.064" in Path("mine.toml").read_text()
    assert run("new", "second", "--from", "mine.toml").exit_code == 0
    assert (cdpr.load_robot("second.toml").name, cdpr.load_robot("second.toml").mass) == ("second", built.mass)
    assert "parallel is a robot of the catalogue as well" in " ".join(run("new", "parallel").stderr.split())
    for name in ("", ".toml"):
        refused = run("new", name)
        assert (refused.exit_code, f"name: found {name!r}, expected a name" in refused.stderr) == (2, True)
    assert "unknown robot 'nothing'" in run("new", "third", "--from", "nothing").stderr
    assert not Path("third.toml").exists()
