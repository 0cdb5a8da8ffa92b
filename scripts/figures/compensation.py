"""Draw the errors along the paper's line without and with compensation: pictures/compensation.png."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

import cdpr_sim as cdpr
from cdpr_sim.analysis.compensation import Compensation, compensate
from cdpr_sim.core.equilibrium import Equilibrium
from cdpr_sim.core.robot import Robot
from cdpr_sim.drawing import style
from cdpr_sim.physics.settle import settle_many
from cdpr_sim.statics.newton import solve_many

ROBOTS = {"cogiro": "crossed cables (Cogiro), fishing line", "parallel": "parallel cables, fishing line"}
MATERIAL = "fishing-0.4mm"
LINE = [(x, 0.25, 0.1) for x in np.linspace(0.17, 0.63, 24)]  # m, the paper's
ARM = None  # m, weight of rotation where the pose cannot be held; None: the characteristic length, 59 mm
DPI = 150
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
        position_only: by MuJoCo, with lengths compensated for the position only; empty if all poses are held exactly.
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
        for_position = np.array([compensate(robot, pose, arm=0).rest_lengths for pose in commanded])
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


BEFORE, AFTER, POSITION, OUT_OF_REACH = style.VERMILLION, style.BLUE, style.GREEN, "#f4f1ea"
"""Colours; the last one shades poses that no lengths can hold."""

INK, MUTED, POINT = style.INK, style.MUTED, style.POINT
SIZE = (8.4, 5.0)


def draw_compensation(lines: Sequence[CompensatedLine]) -> Figure:
    """Errors of position and rotation over the commanded x, before and after compensation: a column per line."""
    figure = Figure(figsize=SIZE, layout="constrained")
    figure.get_layout_engine().set(w_pad=0.08, h_pad=0.05, wspace=0.04, hspace=0.04)  # type: ignore[union-attr]
    axes = figure.subplots(2, len(lines), sharex=True, squeeze=False)
    for column, line in enumerate(lines):
        _panel(axes[0, column], line, "position")
        _panel(axes[1, column], line, "rotation")
        axes[0, column].set_title(line.title, loc="left", fontsize=10, color=INK, pad=9)
        axes[1, column].set_xlabel("commanded x [mm]", color=INK)
    axes[0, 0].set_ylabel("position error [mm]", color=INK)
    axes[1, 0].set_ylabel("rotation error [°]", color=INK)
    entries = {}
    for column in range(len(lines)):
        handles, labels = axes[0, column].get_legend_handles_labels()
        entries |= dict(zip(labels, handles, strict=True))
    figure.legend(
        entries.values(),
        entries.keys(),
        loc="outside lower center",
        ncols=5,
        frameon=False,
        fontsize=8.5,
        columnspacing=1.4,
    )
    return figure


def _power(value: float) -> str:
    """The next power of ten above ``value``."""
    return f"$10^{{{int(np.ceil(np.log10(max(value, 1e-15))))}}}$"


def _panel(axes: Axes, line: CompensatedLine, of: Literal["position", "rotation"]) -> None:
    x = np.array([1e3 * one.commanded.translation[0] for one in line.compensations])
    exact = line.exact

    def errors(results: Sequence[Equilibrium]) -> Float[np.ndarray, " poses"]:
        return 1e3 * line.position_errors(results) if of == "position" else np.degrees(line.rotation_errors(results))

    if not exact.all() and of == "position":
        axes.text(
            0.5, 0.95, "shaded: no cable lengths\nhold the commanded pose", transform=axes.transAxes, ha="center",
            va="top", fontsize=8.5, color=MUTED,
        )  # fmt: skip
    if not exact.all():
        half = np.diff(x).mean() / 2
        for at in x[~exact]:
            axes.axvspan(at - half, at + half, color=OUT_OF_REACH, linewidth=0, zorder=0)
    before, after = errors(line.before), errors(line.after)
    axes.plot(x, before, color=BEFORE, linewidth=style.LINE, label="rigid lengths")
    axes.plot(x, errors(line.settled_before), "o", color=BEFORE, markersize=POINT, mfc="white", label="… in MuJoCo")
    axes.plot(x, after, color=AFTER, linewidth=style.LINE, label="compensated lengths", clip_on=False, zorder=3)
    axes.plot(
        x, errors(line.settled_after), "s", color=AFTER, markersize=POINT, mfc="white", label="… in MuJoCo ",
        clip_on=False, zorder=4,
    )  # fmt: skip
    if line.position_only:
        position_only = errors(line.position_only)
        axes.plot(
            x, position_only, color=POSITION, linewidth=style.LINE, linestyle=(0, (2.2, 1.4)), zorder=2, clip_on=False,
            label="… position only, in MuJoCo",
        )  # fmt: skip
        after = np.append(after, position_only)
    if exact.all():
        worst = max(errors(line.settled_after))
        unit = " mm" if of == "position" else "°"
        axes.annotate(
            f"compensated: at most {_power(worst)}{unit}", (x.mean(), 0), xytext=(0, 11), textcoords="offset points",
            ha="center", fontsize=8.5, color=AFTER,
        )  # fmt: skip
    axes.set_ylim(0, 1.12 * max(before.max(), after.max()))
    axes.set_xlim(x[0] - 12, x[-1] + 12)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(MUTED)
    axes.tick_params(colors=MUTED, labelcolor=INK, labelsize=8.5)
    axes.grid(axis="y", color="#e6e6e6", linewidth=0.6)
    axes.set_axisbelow(True)


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
    draw_compensation(lines).savefig(OUTPUT, dpi=DPI)
    print(OUTPUT.name)


if __name__ == "__main__":
    main()
