"""Draw the errors along the paper's line without and with compensation: pictures/compensation.png."""

# pyright: reportArgumentType=false, reportCallIssue=false
# matplotlib's stubs know no keyword dictionaries.
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import ArrayLike

import cdpr_sim as cdpr
from cdpr_sim.analysis.compensation import Compensation, compensate
from cdpr_sim.core.equilibrium import Equilibrium
from cdpr_sim.core.files import write_whole
from cdpr_sim.core.robot import Robot
from cdpr_sim.drawing import style
from cdpr_sim.drawing.figures import canvas, encoded, key, legend_above, styled
from cdpr_sim.drawing.readable_numbers import power_of_ten
from cdpr_sim.physics.settle import settle_many
from cdpr_sim.statics.newton import solve_many
from robots_on_axes import points

ROBOTS = {"cogiro": "crossed cables (cogiro)", "parallel": "parallel cables (parallel)"}
MATERIAL = "fishing-0.4mm"
LINE = [(x, 0.25, 0.1) for x in np.linspace(0.17, 0.63, 24)]  # m, the paper's
ARM = None  # m, weight of rotation where the pose cannot be held; None: the characteristic length, 59 mm
SMALL_ARM = 1e-3  # m, the same for "position only": with 0 the search stops at tilts up to 5° larger than the least
OUTPUT = Path(__file__).parents[2] / "pictures" / "compensation.png"


@dataclass(frozen=True, eq=False)
class CompensatedLine:
    """A robot's compensation at poses along a line.

    Attributes:
        title: names of the robot and its cables.
        before: by statics, with the rigid lengths, one per pose.
        after: by statics, with the compensated lengths.
        settled_before: by MuJoCo, with the rigid lengths.
        settled_after: by MuJoCo, with the compensated lengths.
        compensations: one per pose.
        position_only: by MuJoCo, compensated almost for the position only; empty if all poses are held exactly.
    """

    title: str
    before: Sequence[Equilibrium]
    after: Sequence[Equilibrium]
    settled_before: Sequence[Equilibrium]
    settled_after: Sequence[Equilibrium]
    compensations: Sequence[Compensation]
    position_only: Sequence[Equilibrium] = ()

    @property
    def exact(self) -> Bool[np.ndarray, " poses"]:
        """(poses,) where the commanded pose is held exactly."""
        return np.array([one.exact for one in self.compensations])

    def position_errors(self, results: Sequence[Equilibrium]) -> Float[np.ndarray, " poses"]:
        """Distance of each of ``results`` from the commanded position [m]."""
        pairs = zip(results, self.compensations, strict=True)
        return np.array([np.linalg.norm(found.position - one.commanded.translation) for found, one in pairs])

    def rotation_errors(self, results: Sequence[Equilibrium]) -> Float[np.ndarray, " poses"]:
        """Angle of each of ``results`` to the commanded rotation [rad]."""
        pairs = zip(results, self.compensations, strict=True)
        return np.array([(found.rotation * one.commanded.rotation.inv()).magnitude() for found, one in pairs])


def compensated_line(robot: Robot, title: str, commanded: ArrayLike, *, arm: float | None = None) -> CompensatedLine:
    """Compensate ``robot`` along a line; compensated equilibria start at the uncompensated ones.

    Args:
        robot: the robot.
        title: name of the robot and its cables.
        commanded: level poses, (poses, 3) [m].
        arm: as in ``compensate`` [m].

    Raises:
        NotConverged: the static solver found no equilibrium at some pose.
        NotSettled: MuJoCo did not settle at some pose.
    """
    commanded = np.asarray(commanded, dtype=float)
    compensations = [compensate(robot, pose, arm=arm) for pose in commanded]
    lengths = np.array([one.rest_lengths for one in compensations])
    before, settled_before = solve_many(robot, commanded), settle_many(robot, commanded)
    position_only: Sequence[Equilibrium] = ()
    if not all(one.exact for one in compensations):
        for_position = np.array([compensate(robot, pose, arm=SMALL_ARM).rest_lengths for pose in commanded])
        position_only = tuple(settle_many(robot, settled_before.poses, for_position))
    return CompensatedLine(
        title=title,
        before=tuple(before),
        after=tuple(solve_many(robot, before.poses, lengths)),
        settled_before=tuple(settled_before),
        settled_after=tuple(settle_many(robot, settled_before.poses, lengths)),
        compensations=compensations,
        position_only=position_only,
    )


BEFORE, AFTER, POSITION, OUT_OF_REACH = style.VERMILLION, style.BLUE, style.GREEN, "#f2f2f2"
"""Colours; the last one shades poses that no lengths can hold."""


@styled
def draw_compensation(lines: Sequence[CompensatedLine]) -> Figure:
    """Errors of position and rotation over the commanded x, before and after compensation: a column per line."""
    figure = canvas(
        style.WIDTH,
        6.0,
        "Compensated lengths remove the error wherever cables can hold the pose",
        f"DemoBot with {MATERIAL} cables, commanded along the paper's line at y = {LINE[0][1]:g} m and z = "
        f"{LINE[0][2]:g} m. Rigid lengths: the distances from exits to anchors. Lines: static solver; hollow points: "
        "MuJoCo, settled. Dashed: lengths that hold the position within 4 µm with the least rotation found, in MuJoCo.",
    )
    handles = [
        key("rigid lengths", **points(BEFORE) | {"ls": "-", "color": BEFORE}),
        key("compensated lengths", **points(AFTER, "s") | {"ls": "-", "color": AFTER}),
        key("compensated in position only", color=POSITION, ls=style.DASHES[1]),
        Patch(fc=OUT_OF_REACH, label="no lengths hold the pose"),
    ]
    axes = legend_above(figure, handles, 4).subgridspec(2, len(lines)).subplots(sharex=True, squeeze=False)
    for column, line in enumerate(lines):
        _panel(axes[0, column], line, "position")
        _panel(axes[1, column], line, "rotation")
        axes[0, column].set_title(line.title)
        axes[1, column].set_xlabel("commanded x [mm]")
    axes[0, 0].set_ylabel("position error [mm]")
    axes[1, 0].set_ylabel("rotation error [°]")
    return figure


def _panel(axes: Axes, line: CompensatedLine, of: Literal["position", "rotation"]) -> None:
    x = np.array([1e3 * one.commanded.translation[0] for one in line.compensations])

    def errors(results: Sequence[Equilibrium]) -> Float[np.ndarray, " poses"]:
        return 1e3 * line.position_errors(results) if of == "position" else np.degrees(line.rotation_errors(results))

    half = np.diff(x).mean() / 2
    for at in x[~line.exact]:
        axes.axvspan(at - half, at + half, color=OUT_OF_REACH, lw=0, zorder=0)
    before, after = errors(line.before), errors(line.after)
    above = {"clip_on": False, "zorder": 7}
    axes.plot(x, before, color=BEFORE, gid="static before")
    axes.plot(x, errors(line.settled_before), **points(BEFORE), gid="mujoco before")
    axes.plot(x, after, color=AFTER, **above | {"zorder": 3}, gid="static after")
    axes.plot(x, errors(line.settled_after), **points(AFTER, "s") | above, gid="mujoco after")
    if line.position_only:
        position_only = errors(line.position_only)
        axes.plot(x, position_only, color=POSITION, ls=style.DASHES[1], clip_on=False, gid="mujoco position only")
        after = np.append(after, position_only)
    if line.exact.all():
        unit = " mm" if of == "position" else "°"
        axes.annotate(
            f"compensated: at most {power_of_ten(max(errors(line.settled_after)))}{unit}", (x.mean(), 0), (0, 11),
            textcoords="offset points", ha="center", fontsize=8.5, color=AFTER,
        )  # fmt: skip
    axes.set_ylim(0, 1.12 * max(before.max(), after.max()))
    axes.set_xlim(x[0] - 12, x[-1] + 12)
    axes.grid(axis="y")


def main() -> None:
    lines = []
    for name, title in ROBOTS.items():
        line = compensated_line(cdpr.load_robot(name).replace(material=MATERIAL), title, LINE, arm=ARM)
        for when, results in (("before", line.settled_before), ("after", line.settled_after)):
            shift, turn = 1e3 * line.position_errors(results).max(), np.degrees(line.rotation_errors(results).max())
            print(f"{name}, {when}: errors in MuJoCo of at most {shift:.3g} mm and {turn:.3g}°")
        print(f"{name}: the commanded pose is held at {line.exact.sum()} of {len(LINE)} points")
        lines.append(line)
    OUTPUT.parent.mkdir(exist_ok=True)
    write_whole({OUTPUT: encoded(draw_compensation(lines))})
    print(OUTPUT.name)


if __name__ == "__main__":
    main()
