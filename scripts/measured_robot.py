"""A real robot, IRMA4U, against rigid and elastic models: fit to 27 measured poses, prediction of 8 others."""

from pathlib import Path

import matplotlib
import numpy as np
from rich.console import Console

from cdpr_sim.drawing import style
from cdpr_sim.report.analysis_tables import identification_note, identification_table
from cdpr_sim.report.table_style import new_table
from studies.measured_robot import MODELS, NATURAL, RIGID, fits, swinging_frequencies
from studies.measured_robot_figures import draw_measured_robot

LEFT_OUT = ("with AHRS zeros", "with a drive line", "with an EA per cable")  # of the figure
LISTED = "elastic, all"  # the model whose unknowns are listed
DPI = 150
OUTPUT = Path(__file__).parent.parent / "pictures" / "measured-robot.png"


def main() -> None:
    console, found = Console(width=120), {}
    table = new_table(
        "Residuals, root mean square: 27 poses fitted, 8 predicted",
        "model", "un-\nknowns", "AICc", "EA [kN]", "tension [N]\nfit", "\npredicted", "roll, pitch [°]\nfit",
        "\npredicted", "swivel [°]\nfit", "\npredicted", dense=True,
    )  # fmt: skip
    for name in MODELS:
        (fit,) = fits([name])
        found[name] = fit
        EA = "-"
        if fit.found and "axial_stiffness" in fit.found.names:
            value, error = fit.found["axial_stiffness"]
            EA = f"{value / 1e3:.1f} ± {error / 1e3:.1f}"
        sizes = [f"{fit.rms(kind, p):.2f}" for kind in ("tension", "rotation", "swivel") for p in (False, True)]
        table.add_row(name, str(fit.unknowns), "-" if np.isnan(fit.aicc) else f"{fit.aicc:.0f}", EA, *sizes)
    console.print(table)
    listed = found[LISTED].found
    assert listed is not None
    console.print(identification_table(listed))
    console.print(identification_note(listed))
    (robust,) = fits(["elastic, calibrated"], robust=True)
    assert robust.found is not None
    value, error = robust.found["axial_stiffness"]
    print(f"By Huber's weights, the calibrated elastic model: EA = {value / 1e3:.1f} ± {error / 1e3:.1f} kN; outliers:")
    print("  " + ("; ".join(map(str, robust.found.outliers)) or "none"))
    each = found["with an EA per cable"].found
    assert each is not None
    print("EA of each cable [kN]: " + ", ".join(f"{each[f'axial_stiffness {i}'][0] / 1e3:.1f}" for i in range(1, 5)))
    print(
        "Natural frequencies with locked cables [Hz]; measured: "
        + ", ".join(f"{name} {low:.2f} to {high:.2f}" for name, (low, high) in NATURAL.items())
    )
    for EA in (RIGID, listed["axial_stiffness"][0]):
        print(f"  EA {EA:9.3g} N: " + ", ".join(f"{one:.2f}" for one in swinging_frequencies(EA)))
    OUTPUT.parent.mkdir(exist_ok=True)
    with matplotlib.rc_context(style.RC):  # type: ignore[arg-type]
        draw_measured_robot([found[name] for name in MODELS if name not in LEFT_OUT]).savefig(OUTPUT, dpi=DPI)
    print(OUTPUT.name)


if __name__ == "__main__":
    main()
