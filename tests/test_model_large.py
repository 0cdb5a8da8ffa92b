"""Models of many bodies: stacks, nets, what delays or prevents their rest; each judged by free-body balance."""

import mujoco
import numpy as np
import pytest

import cdpr_sim as cdpr
from cdpr_sim.anymodel import stiffness
from cdpr_sim.anymodel.forces import RestForces
from cdpr_sim.anymodel.islands import displaced_together

G = 9.81
SIDE = 0.1
"""[m] Half the side of a box."""

BALANCED = 1e-6
"""Force that a body's balance may leave, as a fraction of its weight: the residual of the search is below 1e-8."""

TILTED = 2e-3
"""Of forces across a slope: boxes tilt by 2 mrad on their soft contacts, and with them the normals."""

PARALLEL = 1e-4
"""Of the sum of both: friction at the corners of a box has the same direction, within 1 %."""

ROUNDED = 1e-5
"""Of a stiffness by differences at another step in the others' coordinates, as a fraction of the largest."""


def stacks(columns: int, boxes: int, option: str = "", above: float = 0.0) -> mujoco.MjModel:
    """Columns of boxes of 1 kg on a floor, with a coefficient of friction of 0.5; the top ones start ``above``."""
    bodies = "".join(
        f'<body name="box_{i}_{k}" pos="{i} 0 {(2 * k + 1) * SIDE + (above if k == boxes - 1 else 0)}"><freejoint/>'
        f'<geom type="box" size="{SIDE} {SIDE} {SIDE}" mass="1" friction=".5"/></body>'
        for i in range(columns)
        for k in range(boxes)
    )
    floor = '<geom name="floor" type="plane" size="9 9 1" friction=".5"/>'
    return mujoco.MjModel.from_xml_string(f"<mujoco>{option}<worldbody>{floor}{bodies}</worldbody></mujoco>")


def on_slope(columns: int, boxes: int, slope: float, **more: float) -> mujoco.MjModel:
    """The same under a gravity that is tilted."""
    angle = np.arctan(slope)
    gravity = f"{G * np.sin(angle):.17g} 0 {-G * np.cos(angle):.17g}"
    return stacks(columns, boxes, f'<option gravity="{gravity}"/>', **more)


def net(side: int) -> mujoco.MjModel:
    """A square net of point masses of 10 g that hangs at its corners, 0.1 m between two, of strings that only pull."""
    bodies, strings = [], []
    for i, j in np.ndindex(side, side):
        corner = {i, j} <= {0, side - 1}
        slides = (
            "" if corner else "".join(f'<joint type="slide" axis="{axis}"/>' for axis in ("1 0 0", "0 1 0", "0 0 1"))
        )
        place = f'pos="{0.1 * i} {0.1 * j} 1"'
        geom = '<geom size=".01" mass=".01" contype="0" conaffinity="0"/>'
        bodies.append(f'<body name="n{i}_{j}" {place}>{slides}{geom}<site name="s{i}_{j}"/></body>')
        for k, m in ((i + 1, j), (i, j + 1)):
            if max(k, m) < side:
                ends = f'<site site="s{i}_{j}"/><site site="s{k}_{m}"/>'
                strings.append(f'<spatial name="{i}_{j} {k}_{m}" stiffness="100" springlength="0 .1">{ends}</spatial>')
    return mujoco.MjModel.from_xml_string(
        f"<mujoco><worldbody>{''.join(bodies)}</worldbody><tendon>{''.join(strings)}</tendon></mujoco>"
    )


def unbalanced_nodes(model: mujoco.MjModel, found: cdpr.ModelEquilibrium, tensions: np.ndarray) -> float:
    """Largest force left at a node of the net, by its weight: tensions along the strings, from the positions."""
    data = mujoco.MjData(model)
    found.write(data)
    mujoco.mj_kinematics(model, data)
    left = {model.body(body).name[1:]: np.array([0, 0, -0.01 * G]) for body in range(1, model.nbody)}
    for name, tension in zip(found.tendon_tensions.names, tensions, strict=True):
        one, two = name.split()
        apart = data.body("n" + two).xpos - data.body("n" + one).xpos
        pull = tension * apart / np.linalg.norm(apart)
        left[one] = left[one] + pull
        left[two] = left[two] - pull
    free = [name for name in left if model.body("n" + name).jntnum[0]]
    return max(float(np.linalg.norm(left[name])) for name in free) / (0.01 * G)


def test_a_net_of_many_degrees_of_freedom_balances_at_each_node():
    """180 of them: by the tensions and the directions of the strings alone; a string that pulls 0.1 % more shows."""
    model = net(8)
    assert model.nv == 180
    found = cdpr.settle_model(model)
    assert found.stable
    assert found.agreement is not None
    assert found.agreement.agrees
    tensions = found.tendon_tensions.total
    assert unbalanced_nodes(model, found, tensions) < BALANCED
    wrong = tensions.copy()
    wrong[np.argmax(wrong)] *= 1.001
    assert unbalanced_nodes(model, found, wrong) > BALANCED


def test_each_box_of_a_stack_on_a_slope_carries_those_above():
    """Between two boxes, the normal force is the weight above times the cosine, with friction the whole weight."""
    boxes = 5
    model = on_slope(1, boxes, 0.05)
    found = cdpr.settle_model(model)
    assert found.agreement is not None
    assert found.agreement.agrees
    angle, joined = np.arctan(0.05), {}
    for one in found.contact_forces:
        joined.setdefault(one.bodies, []).append(one)
    assert len(joined) == boxes
    for bodies, contacts in joined.items():
        above = boxes - max(int(name[-1]) for name in bodies if name != "world")
        normal, friction = (sum(getattr(one, part) for one in contacts) for part in ("normal", "friction"))
        assert normal == pytest.approx(above * G * np.cos(angle), rel=TILTED)
        assert np.hypot(normal, friction) == pytest.approx(above * G, rel=PARALLEL)
    friction = found.friction.reshape(boxes, 6)[:, 0]  # between two boxes it cancels
    assert friction.sum() == pytest.approx(-boxes * G * np.sin(angle), rel=BALANCED)
    assert found.friction_share >= 0.05 / 0.5 - 1e-6


def test_bodies_that_fall_are_not_held_by_the_friction_of_others():
    """The upper boxes drop 0.3 m onto stacks that stand already; in the end each carries its load."""
    model = on_slope(3, 2, 0.2, above=0.3)
    found = cdpr.settle_model(model)
    pressed = sum(one.normal for one in found.contact_forces if "world" in one.bodies)
    assert pressed == pytest.approx(model.body_mass.sum() * G * np.cos(np.arctan(0.2)), rel=BALANCED)
    heights = found.qpos.reshape(-1, 7)[1::2, 2]
    assert heights == pytest.approx(np.full(3, 3 * SIDE), abs=1e-3)


def test_independent_bodies_are_displaced_together_and_the_stiffness_is_the_same():
    """Three stacks of four: in each, every second neighbour apart; 18 sets in place of 72 columns."""
    model = on_slope(3, 4, 0.2)
    found = cdpr.settle_model(model)
    forces = RestForces(model, mujoco.MjData(model))
    forces.net(found.qpos)
    sets = displaced_together(forces.model, forces.data)
    assert len(sets) == 18
    assert sorted(dof for one in sets for dof, _ in one) == list(range(model.nv))
    (together,) = stiffness.stiffness_of(forces, found.qpos, [np.arange(model.nv)])
    alone = np.empty_like(together)
    for dof, step in enumerate(stiffness.STEP * np.eye(model.nv)):
        ahead, behind = (forces.net(forces.moved(found.qpos, sign * step)).force for sign in (1, -1))
        alone[:, dof] = (behind - ahead) / (2 * stiffness.STEP)
    assert np.abs(together - alone).max() < ROUNDED * np.abs(alone).max()


def test_noslip_is_left_out_and_said():
    """Its forces are found after MuJoCo's solver, from the step before: at rest they would not balance."""
    found = {}
    for noslip in (0, 4):
        model = on_slope(1, 2, 0.2)
        model.opt.noslip_iterations = noslip
        found[noslip] = cdpr.settle_model(model)
        assert any("noslip" in note for note in found[noslip].notes) is bool(noslip)
    assert found[4].qpos[2::7] == pytest.approx(found[0].qpos[2::7], abs=1e-7)


FLIPS = """<mujoco><worldbody><geom name="drum" type="cylinder" size=".3 .5" euler="90 0 0"/>
<site name="low" pos="0 0 -1"/><site name="right" pos="1 0 0"/>
<body name="bead" pos=".02 0 1"><joint name="rail" type="slide" axis="1 0 0" damping="1"/>
<geom size=".01" mass=".1" contype="0" conaffinity="0"/><site name="bead"/></body></worldbody>
<tendon><spatial name="rod" stiffness="10" springlength="5"><site site="low"/><geom geom="drum"{}/><site site="bead"/>
</spatial></tendon></mujoco>"""


def test_a_tendon_that_changes_its_side_keeps_a_body_in_motion():
    """A rod around a drum pushes a bead back across the middle; there it turns to the other side, and so on."""
    model = mujoco.MjModel.from_xml_string(FLIPS.format(""))
    with pytest.raises(cdpr.NotSettled, match=r"jumps by \d+% .* where tendon 'rod' changes its path$") as caught:
        cdpr.settle_model(model, most_steps=3000)
    assert caught.value.case is cdpr.NoRest.JUMPS
    assert caught.value.joints == ("rail",)
    data, speeds = mujoco.MjData(model), []
    for _ in range(10_000):  # 20 s with damping, of which the last show that it does not end
        mujoco.mj_step(model, data)
        speeds.append(abs(float(data.qvel[0])))
    assert max(speeds[-100:]) > 0.1
    (finding,) = [one for one in cdpr.diagnose_model(model) if one.kind is cdpr.FindingKind.NO_REST]
    assert finding.remedy.startswith("give the tendon's geom a sidesite")
    one_side = mujoco.MjModel.from_xml_string(FLIPS.format(' sidesite="right"'))
    found = cdpr.settle_model(one_side)
    assert found.stable
    assert found.tendon_tensions.lengths == pytest.approx([5], abs=1e-6)


def test_more_degrees_of_freedom_than_a_full_matrix_allows_are_refused():
    """At once, in one sentence, not after minutes."""
    with pytest.raises(cdpr.InvalidInput, match=r"^model: found 2340 degrees of freedom, expected at most 2000: "):
        cdpr.settle_model(net(28))
