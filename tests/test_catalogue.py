import re

import numpy as np
import pytest

import cdpr_sim as cdpr
from cdpr_sim.robots.catalogue import PAPER_ROBOTS

TABLE_II = {
    "cogiro": """
        A1 .08 .04 .485  B1  .04   -.03   .018      A5 .72 .46 .485  B5 -.04    .03   .018
        A2 .04 .08 .485  B2 -.0515  .022 -.018      A6 .76 .42 .485  B6  .0515 -.022 -.018
        A3 .04 .42 .485  B3 -.0515 -.022  .018      A7 .76 .08 .485  B7  .0515  .022  .018
        A4 .08 .04 .485  B4  .04    .03  -.018      A8 .72 .04 .485  B8 -.04   -.03  -.018
    """,
    "parallel": """
        A1 .04 .04 .486  B1 -.0515 -.022  .018      A5 .76 .46 .486  B5  .0515  .022  .018
        A2 .04 .04 .450  B2 -.0515 -.022 -.018      A6 .76 .46 .450  B6  .0515  .022 -.018
        A3 .04 .46 .486  B3 -.0515  .022  .018      A7 .76 .04 .486  B7  .0515 -.022  .018
        A4 .04 .46 .450  B4 -.0515  .022 -.018      A8 .76 .04 .450  B8  .0515 -.022 -.018
    """,
}
"""The paper's Table II as it is printed [m]: exits A_i in the base frame, anchors B_i in the platform frame."""

ERRATUM = {"cogiro": (3, [0.08, 0.46, 0.485])}
"""The paper prints A4 of the Cogiro layout as (.08, .04, .485), a repeat of A1. The layout is symmetric under a half
turn about the vertical through (.4, .25), which takes A1 to A5, A2 to A6 and A3 to A7, and B likewise; so A4 is the
image of A8 = (.72, .04, .485)."""


def test_catalogue_has_the_papers_five_robots():
    """The names that others rely on, among all that have a file."""
    assert PAPER_ROBOTS == ("cogiro", "parallel", "planar-horizontal", "planar-vertical", "two-cable")
    assert set(PAPER_ROBOTS) <= set(cdpr.list_robots())


def printed(table: str) -> tuple[np.ndarray, np.ndarray]:
    """Exits and anchors of a table, in order, (8, 3) each."""
    rows = {name: [float(x) for x in xyz.split()] for name, xyz in re.findall(r"([AB]\d)([-. \d]+)", table)}
    return tuple(np.array([rows[f"{letter}{i}"] for i in range(1, 9)]) for letter in "AB")


@pytest.mark.parametrize("name", sorted(TABLE_II))
def test_the_catalogue_has_the_papers_numbers(name):
    """Every exit and anchor of Table II, to the last digit, but for the one that is misprinted."""
    exits, anchors = printed(TABLE_II[name])
    if name in ERRATUM:
        cable, mended = ERRATUM[name]
        np.testing.assert_array_equal(exits[cable], exits[0])  # as printed: a repeat of A1
        exits[cable] = mended
    robot = cdpr.load_robot(name)
    np.testing.assert_array_equal(robot.exits, exits)
    np.testing.assert_array_equal(robot.anchors, anchors)


def test_robots_without_a_table_are_what_their_descriptions_say():
    """Fig. 6b: exits a platform width apart, anchors at the ends of the top edge. Fig. 2: the frame's upper corners."""
    horizontal, pair = cdpr.load_robot("planar-horizontal"), cdpr.load_robot("two-cable")
    width, _, height = [0.103, 0.044, 0.036]  # between Table II's anchors
    np.testing.assert_array_equal(horizontal.exits[:, 2], 0.486)
    np.testing.assert_allclose(horizontal.exits[:, 0], [0.04, 0.04 + width, 0.76 - width, 0.76], rtol=1e-15)
    np.testing.assert_allclose(
        horizontal.anchors[:, [0, 2]], [[side * width / 2, height / 2] for side in (-1, 1, -1, 1)], rtol=1e-15
    )
    np.testing.assert_array_equal(pair.exits, [[0, 0, 0.5], [0.8, 0, 0.5]])
    np.testing.assert_allclose(pair.anchors, [[-0.051, 0, 0], [0.051, 0, 0]], rtol=1e-15)


def test_planar_vertical_is_the_projection_of_parallel():
    """Fig. 6a has no table: its cables are those of `parallel`, seen along y."""
    spatial, planar = cdpr.load_robot("parallel"), cdpr.load_robot("planar-vertical")

    def seen(robot):
        return {tuple(row) for row in np.hstack([robot.exits, robot.anchors])[:, [0, 2, 3, 5]].tolist()}

    assert seen(planar) == seen(spatial)


def test_demobot_is_the_papers(catalogue):
    """0.4 kg, a platform of 102 x 44 x 36 mm, a frame 0.8 m wide and 0.5 m high, Vectran: all five."""
    for robot in (catalogue[name] for name in PAPER_ROBOTS):
        assert robot.mass == 0.4
        np.testing.assert_array_equal(robot.platform_size, [0.102, 0.044, 0.036])
        np.testing.assert_array_equal(np.ptp(robot.frame, axis=0)[[0, 2]], [0.8, 0.5])
        assert robot.material == "vectran-0.7mm"
        assert (robot.axial_stiffness == 10e3).all()
    for name in TABLE_II:
        np.testing.assert_array_equal(catalogue[name].frame, [[0, 0, 0], [0.8, 0.5, 0.5]])
