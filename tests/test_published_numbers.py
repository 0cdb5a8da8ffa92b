"""Numbers that others published of cable robots and cables: 75 of them, each with its source and its precision.

IRMA4U's 27 equilibria, of the University of Bologna, have a file of their own.
"""

import numpy as np
import pytest

import cdpr_sim as cdpr
from cdpr_sim.statics.forces import geometry
from cdpr_sim.statics.profiles import catenary

POSITION = np.array([0.1, 0.2, 1.0])

WIREX_ROUNDING = 2e-15
"""WireX prints 16 digits of lengths around 3 m and of components up to 1: what two orders of summing differ by."""

MOORPY_PRECISION = 1e-5
"""The relative precision to which MoorPy's own test holds."""

WIREX_MATRIX = np.array([  # a row per cable: its direction, and its moment about the platform's origin [m]
    (-0.7881678136715315, 0.4790823965454407, 0.3863567714076135,
     0.023181406284456807, 0.023181406284456807, 0.018545125027565453),
    (0.7560310364971451, 0.5094991767698152, 0.4108864328788832,
     0.024653185972732992, -0.024653185972732992, -0.014791911583639798),
    (0.6917488766649749, -0.6165587813753037, 0.37595047644835594,
     -0.022557028586901357, -0.022557028586901357, 0.004511405717380269),
    (-0.728051577325381, -0.5852963660851102, 0.35688802810067694,
     -0.021413281686040616, 0.021413281686040616, -0.00856531267441625),
    (-0.7881678136715315, 0.4790823965454407, -0.3863567714076135,
     -0.023181406284456807, -0.023181406284456807, 0.018545125027565453),
    (0.7560310364971451, 0.5094991767698152, -0.4108864328788832,
     -0.024653185972732992, 0.024653185972732992, -0.014791911583639798),
    (0.6917488766649749, -0.6165587813753037, -0.37595047644835594,
     0.022557028586901357, 0.022557028586901357, 0.004511405717380269),
    (-0.728051577325381, -0.5852963660851102, -0.35688802810067694,
     0.021413281686040616, -0.021413281686040616, -0.00856531267441625),
])  # fmt: skip
"""WireX (Andreas Pott), Scripts/wcUnitTest.py, test_Ikin_structureMatrix_compliance644: IPAnema 1 at ``POSITION``."""

WIREX_LENGTHS = np.array([2.5882812830138846, 2.433762519228201, 2.659924810967408, 2.8019992862240346] * 2)
"""[m] The same file, test_Ikin_inversekinematics_compliance644, at the same pose."""

WIREX_LENGTH_IN_THE_MIDDLE = 2.6148040079516472
"""[m] The same file, test_Ikin_inversekinematics: every cable at (0, 0, 1) m."""

MOORPY = {  # x, z, rest length [m], EA [N], weight [N/m]; horizontal force, vertical forces on A and on B [N]
    "hanging below both ends": (
        (400, 200, 500, 7.51e12, 200.0), (43694.580989249596, -22365.599350216216, -77634.40064978378),
    ),
    "short and heavy": (
        (89.9, 59.2, 130.0, 7.51e8, 881.05), (31373.229006023103, -26650.341270116318, -87886.15872988368),
    ),
    "buoyant, upside down": (
        (37.96888656874307, -20.49078283711694, 100.0, 7.51e8, 881.0549577007893),
        (6428.437434537766, -53178.729367882406, -34926.76640219652),
    ),
    "nearly taut, 1 cm shorter": (
        (246.22420940032947, 263.55766330843164, 360.62566262396927, 7e8, 3.08735), (71116.8, 75567.3, -76680.6),
    ),
    "nearly taut, 1 cm longer": (
        (246.22420940032947, 263.55766330843164, 360.64566262396927, 7e8, 3.08735), (46077.1, 48765.2, -49878.6),
    ),
    "nearly taut, from a hard start": (
        (119.3237383002058, 52.49668849178113, 130.36140355177318, 7e8, 34.91060469991227),
        (72694.145, 29715.173, -34266.168),
    ),
}  # fmt: skip
"""MoorPy (NREL), tests/test_catenary.py, its cases 3 to 6, 8 and 9: those that touch no sea bed, and are right."""

MOORPY_7 = (246.22420940032947, 263.55766330843164, 360.63566262396927, 7e8, 3.08735), (56804.6, 60803.4, -60803.4)
"""Its case 7, whose two vertical forces are equal: nothing holds the line's 1113 N."""


@pytest.fixture(scope="module")
def ipanema() -> cdpr.Robot:
    """IPAnema 1 of Fraunhofer IPA: WireX's model IPAnema1Design; load and ropes play no part in what is compared."""
    corners = np.array([(-1, 1), (1, 1), (1, -1), (-1, -1)] * 2)
    return cdpr.Robot(
        exits=np.column_stack([corners * [2, 1.5], [2.0] * 4 + [0.0] * 4]),
        anchors=np.column_stack([corners * 0.06, np.zeros(8)]),
        axial_stiffness=1e6,
        mass=25,
        gravity=0,
    )


def test_structure_matrix_and_lengths_are_those_of_wirex(ipanema):
    """48 numbers and 8, to the last digits; a centimetre in one coordinate would show in the third."""
    state = geometry(ipanema, POSITION, np.eye(3))
    assert state.wrench_matrix.T == pytest.approx(WIREX_MATRIX, abs=WIREX_ROUNDING)  # noqa: SIM300
    assert ipanema.rest_lengths(POSITION) == pytest.approx(WIREX_LENGTHS, abs=WIREX_ROUNDING)
    off = geometry(ipanema, POSITION + np.array([0.01, 0, 0]), np.eye(3)).wrench_matrix.T
    assert np.abs(off - WIREX_MATRIX).max() > 1e-3


def test_lengths_in_the_middle_are_those_of_wirex(ipanema):
    """All eight are the same there."""
    assert ipanema.rest_lengths((0, 0, 1)) == pytest.approx(np.full(8, WIREX_LENGTH_IN_THE_MIDDLE), abs=WIREX_ROUNDING)


def test_an_imported_ipanema_has_wirex_numbers(ipanema, tmp_path):
    """From geometry through the file format to lengths: what their program computes from such a file, ours does."""
    chains = "".join(
        f'<chain><base x="{a[0]}" y="{a[1]}" z="{a[2]}" radius="0"/>'
        f'<platform x="{b[0]}" y="{b[1]}" z="{b[2]}"/></chain>'
        for a, b in zip(ipanema.exits, ipanema.anchors, strict=True)
    )
    file = tmp_path / "ipanema.wcrfx"
    file.write_text(f'<models><robot motionpattern="3R3T"><geometry>{chains}</geometry></robot></models>')
    assert cdpr.import_robot(file).rest_lengths(POSITION) == pytest.approx(WIREX_LENGTHS, abs=WIREX_ROUNDING)


@pytest.mark.parametrize("case", MOORPY)
def test_hanging_cables_pull_as_moorpy_says(case):
    """Three forces each: on the anchor, horizontally and vertically, and at the exit."""
    (x, z, *cable), (horizontal, below, above) = MOORPY[case]
    found = catenary([0, 0, 0], [x, 0, z], *cable)
    assert found.pull == pytest.approx(np.array([-horizontal, 0, above]), rel=MOORPY_PRECISION)
    at_exit = np.array([horizontal, 0, -found.pull[2] - cable[0] * cable[2]])  # what is left of the weight
    assert at_exit[2] == pytest.approx(below, rel=MOORPY_PRECISION)
    assert found.exit_tension == pytest.approx(np.hypot(horizontal, below), rel=MOORPY_PRECISION)


def test_moorpys_seventh_case_is_the_massless_line():
    """Its forces are those of a line without weight, to all digits; with its weight they are off by 3 %."""
    (x, z, length, stiffness, weight), (horizontal, below, above) = MOORPY_7
    assert abs(below + above + weight * length) > 1113  # what no force balances
    published = np.array([-horizontal, 0, above])
    assert catenary([0, 0, 0], [x, 0, z], length, stiffness, 0.0).pull == pytest.approx(published, rel=MOORPY_PRECISION)
    heavy = catenary([0, 0, 0], [x, 0, z], length, stiffness, weight).pull
    assert heavy[[0, 2]] / published[[0, 2]] == pytest.approx([1.0277, 1.0369], abs=1e-4)
