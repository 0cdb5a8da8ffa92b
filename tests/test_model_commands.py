"""``cdpr-sim settle-model`` and ``cdpr-sim diagnose``: tables, JSON, a copy with the keyframe ``rest``, exit status."""

import json
import re

import mujoco
import numpy as np
import pytest
from typer.testing import CliRunner

import cdpr_sim as cdpr
from cdpr_sim.cli import app

BOX = """<mujoco>
  <!-- a comment that stays -->
  <worldbody>
    <geom name="floor" type="plane" size="1 1 0.1"/><site name="hook" pos="0 0 1"/>
    <body name="box" pos="0 0 0.2">
      <freejoint name="free"/><geom type="box" size="0.1 0.1 0.1" mass="1"/><site name="load"/>
    </body>
    <body name="arm" pos="1 0 1">
      <joint name="lift" type="slide" axis="0 0 1" stiffness="100" damping="5"/><geom size="0.1" mass="2"/>
      <body name="hand" pos="0.5 0 0">
        <joint name="elbow" axis="0 1 0" range="-10 10" damping="1"/><geom size="0.05" pos="0.1 0 0" mass="0.3"/>
      </body>
    </body>
    <body name="target" mocap="true" pos="0 1 1"><geom size="0.01" contype="0" conaffinity="0"/></body>
  </worldbody>
  <tendon>
    <spatial name="rope" stiffness="1000" springlength="0 0.5"><site site="hook"/><site site="load"/></spatial>
    <spatial name="loose" range="0 2"><site site="hook"/><site site="load"/></spatial>
  </tendon>
  <actuator><position name="grip" joint="elbow" kp="1" ctrlrange="-1 1"/></actuator>
  <keyframe><key name="low" qpos="0 0 0.15 1 0 0 0 0 0" mpos="0 1 2" mquat="1 0 0 0"/></keyframe>
</mujoco>
"""
"""A box on a rope, an arm on a spring whose hand lies on its limit, a rope that is slack, a target."""

FALLING = '<mujoco><worldbody><body name="ball"><freejoint name="free"/><geom size="0.1"/></body></worldbody></mujoco>'
UPRIGHT = """<mujoco><worldbody><body><joint name="pivot" axis="0 1 0"/><geom size="0.1" pos="0 0 1"/></body>
</worldbody></mujoco>"""


def run(*words: str):
    return CliRunner().invoke(app, list(words), env={"COLUMNS": "100"})


@pytest.fixture
def box(tmp_path, monkeypatch):
    """A folder with the model."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "box.xml").write_text(BOX)
    return tmp_path


def test_the_table_of_settle_model_is_as_reviewed(box, snapshot):
    """Joints in mm and degrees, tensions by their parts."""
    result = run("settle-model", "box.xml")
    assert result.exit_code == 0, result.stderr
    told = re.sub(r"unbalanced +\S+", "unbalanced   0", result.stdout)
    snapshot("outputs/settle-model.txt", told, 1e-3)


def test_the_numbers_of_settle_model_are_those_of_free_bodies(box):
    """The rope carries 9.81 N and is 9.81 mm longer; the arm's spring carries 2.3 kg; the slack rope nothing."""
    result = run("settle-model", "box.xml", "--json")
    assert result.exit_code == 0, result.stderr
    found = json.loads(result.stdout)
    rope, loose = found["tendons"]
    assert rope["tension"] == rope["spring"] == pytest.approx(9.81, rel=1e-6)
    assert (loose["tension"], loose["slack"]) == (0.0, True)
    assert found["joints"]["free"][2] == pytest.approx(1 - 0.5 - 9.81 / 1000, rel=1e-6)
    assert found["joints"]["lift"] == [pytest.approx(-2.3 * 9.81 / 100, rel=1e-6)]
    assert found["agrees"] is True
    assert found["residual"] < 1e-8
    assert found["qpos"] == [*found["joints"]["free"], *found["joints"]["lift"], *found["joints"]["elbow"]]


def test_start_controls_and_bodies_are_those_that_options_name(box):
    """A keyframe by name and by number; a control that lifts the hand off its limit; a body that stays where it is."""
    for keyframe in ("low", "0"):
        words = ("settle-model", "box.xml", "--keyframe", keyframe, "--ignore", "box", "--json")
        found = json.loads(run(*words).stdout)
        assert found["joints"]["free"][2] == 0.15
    lifted = json.loads(run("settle-model", "box.xml", "--ctrl", "-0.2", "--json", "--seconds", "50").stdout)
    assert lifted["ctrl"] == [-0.2]
    assert (
        lifted["joints"]["elbow"][0] < json.loads(run("settle-model", "box.xml", "--json").stdout)["joints"]["elbow"][0]
    )


def test_the_copy_starts_at_rest_and_is_else_the_same(box):
    """The keyframe is read back exactly, ``mj_step`` stays there, and all other text stays."""
    result = run("settle-model", "box.xml", "--keyframe", "low", "--ctrl", "0.1", "--save", "rest.xml")
    assert result.exit_code == 0, result.stderr
    assert "rest.xml: keyframe rest" in result.stdout
    text = (box / "rest.xml").read_text()
    before, after = BOX.split("</mujoco>")
    assert text.startswith(before)
    assert text.endswith("</mujoco>" + after)
    model = mujoco.MjModel.from_xml_path(str(box / "rest.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("rest").id)
    start = cdpr.settle_model(model, data)
    assert start.way == "start"
    np.testing.assert_array_equal(data.mocap_pos, [[0, 1, 2]])
    np.testing.assert_array_equal(data.ctrl, [0.1])
    pose = np.array(data.qpos)
    mujoco.mj_step(model, data, 500)
    np.testing.assert_allclose(data.qpos, pose, atol=1e-9)


def test_a_copy_of_the_copy_has_one_keyframe_rest(box):
    """``--force`` replaces the file, and the new keyframe the old one."""
    assert run("settle-model", "box.xml", "--save", "rest.xml").exit_code == 0
    refused = run("settle-model", "rest.xml", "--save", "rest.xml")
    assert refused.exit_code == 2
    assert refused.stderr == "cdpr-sim: rest.xml: exists, expected a new place or --force\n"
    again = run("settle-model", "rest.xml", "--keyframe", "rest", "--save", "rest.xml", "--force")
    assert again.exit_code == 0, again.stderr
    assert "It was at rest at the start." in again.stdout
    assert (box / "rest.xml").read_text().count('name="rest"') == 1


def test_a_copy_that_would_lose_its_files_is_refused_before_work(box, monkeypatch):
    """A model with an include, saved to another folder; nothing is left there."""
    (box / "scene.xml").write_text('<mujoco><include file="box.xml"/></mujoco>')
    (box / "other").mkdir()
    with monkeypatch.context() as patch:
        patch.setattr(cdpr, "settle_model", None)
        result = run("settle-model", "scene.xml", "--save", "other/rest.xml")
    assert result.exit_code == 2
    assert "the copy would not be read there, expected a place in '.', where the model finds its files" in result.stderr
    assert list((box / "other").iterdir()) == []
    assert run("settle-model", "scene.xml", "--save", "rest.xml").exit_code == 0


SPRING = """<mujoco><worldbody><body><joint name="spring" type="slide" axis="0 0 1" stiffness="100"/>
<geom size="0.1" mass="1"/></body></worldbody></mujoco>"""

ENDS = [  # a command, a model, options; its exit status, and words of what it prints
    ("settle-model", BOX, "", 0, "rope"), ("settle-model", UPRIGHT, "", 1, ""), ("settle-model", FALLING, "", 2, ""),
    ("settle-model", FALLING, "--ignore ball", 0, ""), ("settle-model", "<mujoco/>", "", 0, ""),
    ("settle-model", SPRING, "", 0, "spring mm 0.000 -98.100"),  # a model without tendons
    ("diagnose", BOX, "", 1, "- joint 'elbow': its range carries"), ("diagnose", BOX, "", 1, "time step 2 ms"),
    ("diagnose", BOX, "--ctrl -0.4", 0, "Nothing is wrong that is looked for."), ("diagnose", FALLING, "", 1, ""),
    ("diagnose", FALLING, "--ignore ball", 0, ""),
]  # fmt: skip


@pytest.mark.parametrize(("command", "text", "words", "status", "told"), ENDS)
def test_the_exit_status_says_whether_it_rests_or_something_is_wrong(command, text, words, status, told, tmp_path):
    """At an equilibrium 0, at an unstable one 1, where it falls for ever 2; of findings 1."""
    (tmp_path / "model.xml").write_text(text)
    result = run(command, str(tmp_path / "model.xml"), *words.split())
    assert result.exit_code == status, result.output
    assert told in " ".join(result.stdout.split())
    assert (result.stderr == "") == (status != 2)


def test_a_diagnosis_in_json(box):
    """Its findings and the stable time steps; of what falls no period, which is null."""
    found = json.loads(run("diagnose", "box.xml", "--json", "--keyframe", "low", "--seconds", "20").stdout)
    assert [one["kind"] for one in found["findings"]] == ["limit_carries"]
    assert min(found["stable_time_steps"].values()) > 2e-3
    (box / "ball.xml").write_text(FALLING)
    assert json.loads(run("diagnose", "ball.xml", "--json").stdout)["fastest_period"] is None


def test_a_compiled_model_is_read_but_not_copied(box):
    """It has no text to which a keyframe could be added."""
    mujoco.mj_saveModel(mujoco.MjModel.from_xml_string(BOX), "box.mjb")
    assert run("settle-model", "box.mjb").exit_code == 0
    assert "found a compiled model, expected MJCF" in run("settle-model", "box.mjb", "--save", "rest.xml").stderr
