"""Static equilibria of models of others: ``python scripts/research/rest_of_models.py [--root SOURCE=FOLDER]...``.

Models are read from the packages dm_control, gymnasium, gymnasium-robotics and myo-sim where they are installed (or
from ``--root``), and from checkouts of google-deepmind/mujoco (``--root mujoco=FOLDER``) and of
google-deepmind/mujoco_menagerie (``--root menagerie=FOLDER``). Nothing of them is copied. Each model runs in a process
of its own. Printed per model:

- bodies, degrees of freedom, the way to the equilibrium and its residual, time, agreement of the two ways, or the
  reason why there is none; times are those of the process, so that other programs do not count;
- "needs": the force that MuJoCo's inverse dynamics at zero velocity needs there, over the largest force of gravity or
  actuators, the friction that holds subtracted (MuJoCo's has no force at rest). An answer is right below 1e-6;
- beside it the residual after ten seconds of ``mj_step`` with the model's own damping: what users do today.
"""

# pyright: reportAttributeAccessIssue=false
# mujoco ships no type stubs for its compiled modules.
import argparse
import csv
import importlib.util
import multiprocessing
import sys
import time
from pathlib import Path

import mujoco
import numpy as np

import cdpr_sim as cdpr

SECONDS = 60.0  # [s] of computing that the search may take, per model
LONGEST = 900.0  # [s] of a clock after which the process of a model ends
STEPPED = 10.0  # [s] of mj_step
STEPPING_TIME = 6.0  # [s] of computing that mj_step may take
RIGHT = 1e-6  # largest force that inverse dynamics may need, over the largest force of gravity or actuators

MODELS = {
    "mujoco": """slider_crank/slider_crank car/car cube/cube_3x3x3 humanoid/humanoid adhesion/fridge_door
        replicate/newton_cradle replicate/helix mug/mug tendon_arm/arm26 hammock/hammock testdata/catenary
        testdata/tendon_wrap testdata/connect testdata/weld testdata/tendon_springlength passive/poly_stiffness
        island/abacus sleep/tendon sleep/tendon2 core_smooth/tendon_wrap_cylinder core_smooth/tendon_wrap_sphere
        core_smooth/ten_J3 core_smooth/ten_armature_4 actuation/tendon_force_clamp actuation/tendon_dampratio
        actuation/refsite core_constraint/tendon_limited_bilateral_margin testdata/equality_site actuator/arm21
        tendon/fixed_site_wrap tendon/pulley_site_wrap tendon/pulley_wrap tendon/wrap_sidesite surfacevel/treadmill
        surfacevel/carousel actuator/pid testdata/delay derivative/dcmotor collision_convex/stacked_boxes cards/cards
        balloons/balloons replicate/tendon tactile/tactile flex/trampoline""",
    "dm_control": """suite/acrobot suite/ball_in_cup suite/cartpole suite/cheetah suite/dog suite/finger suite/fish
        suite/hopper suite/humanoid suite/humanoid_CMU suite/manipulator suite/pendulum suite/point_mass suite/quadruped
        suite/reacher suite/stacker suite/swimmer suite/walker kinova/jaco_arm assets/rodent""",
    "gymnasium": """assets/ant assets/half_cheetah assets/hopper assets/humanoid assets/humanoidstandup
        assets/inverted_pendulum assets/inverted_double_pendulum assets/pusher_v5 assets/reacher assets/swimmer
        assets/walker2d_v5""",
    "gymnasium_robotics": """adroit_hand/adroit_hammer adroit_hand/adroit_pen adroit_hand/adroit_door hand/reach
        hand/manipulate_block fetch/reach fetch/pick_and_place kitchen_franka/kitchen_assets/kitchen_env_model""",
    "myo_sim": """elbow/myoelbow_1dof6muscles elbow/myoelbow_2dof6muscles elbow/myoelbow_1dof6muscles_1dofexo
        finger/finger_v0 finger/motorfinger_v0 finger/myofinger_v0 osl/myolegs_osl""",
    "menagerie": """agility_cassie/scene anybotics_anymal_c/scene franka_emika_panda/scene kuka_iiwa_14/scene
        robotiq_2f85/scene shadow_hand/scene_left shadow_hand/scene_right wonik_allegro/scene_left aloha/scene
        leap_hand/scene_left leap_hand/scene_right stanford_tidybot/scene ufactory_xarm7/scene unitree_g1/scene
        unitree_h1/scene unitree_go1/scene universal_robots_ur5e/scene boston_dynamics_spot/scene iit_softfoot/scene""",
}
"""Ends of the models' paths, without ``.xml``."""

WITHOUT_REST = {
    "actuator/pid": "plugin that has a state", "testdata/delay": "delay", "derivative/dcmotor": "DC motor",
    "flex/trampoline": "flex",
    "replicate/tendon": "its force jumps",
    "testdata/catenary": "turns for ever", "surfacevel/treadmill": "surface that moves",
    "surfacevel/carousel": "surface that moves",
    "assets/inverted_double_pendulum": "mechanism", "hand/manipulate_block": "falls for ever",
}  # fmt: skip
"""Models without a rest, or with elements that are refused by name; and what the sentence must say."""

COLUMNS = ["model", "verdict", "bodies", "dofs", "way", "residual", "seconds", "agreement", "needs", "step10s"]


def row_of(path: str, pipe: object, steps: bool) -> None:
    """Compute one model's row, and send it."""
    time.monotonic = time.process_time
    try:
        model = mujoco.MjModel.from_xml_path(path)
    except ValueError as error:
        pipe.send({"unreadable": " ".join(str(error).split())})  # type: ignore[attr-defined]
        return
    start = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, start, 0)
        start.qvel[:] = 0
    row = {"bodies": model.nbody - 1, "dofs": model.nv}
    begin = time.monotonic()
    try:
        found = cdpr.settle_model(model, start, seconds=SECONDS)
    except cdpr.CdprError as error:
        row |= {"seconds": time.monotonic() - begin, "agreement": " ".join(str(error).split())}
    else:
        row |= {"seconds": time.monotonic() - begin, "way": found.way, "residual": found.residual}
        one = found.agreement
        row["agreement"] = "was at rest" if one is None else "; ".join(one.reasons) or f"agree ({one.newton_from})"
        row["needs"] = needed(model, start, found)
    if steps:
        row["step10s"] = after_steps(model, start)
    pipe.send(row)  # type: ignore[attr-defined]


def needed(model: mujoco.MjModel, start: mujoco.MjData, found: cdpr.ModelEquilibrium) -> float:
    """The force that ``mj_inverse`` needs at the equilibrium, over the largest of gravity and actuators."""
    data = copied(model, start)
    found.write(data)
    mujoco.mj_forward(model, data)
    return unbalanced(model, data, found.friction)


def unbalanced(model: mujoco.MjModel, data: mujoco.MjData, friction: np.ndarray) -> float:
    """The same of a state, whose velocity and acceleration are set to zero."""
    data.qvel[:], data.qacc[:] = 0, 0
    mujoco.mj_forward(model, data)
    bias, actuators = np.array(data.qfrc_bias), np.array(data.qfrc_actuator)
    data.qacc[:] = 0
    mujoco.mj_inverse(model, data)
    size = np.sqrt(model.dof_M0)
    missing = np.abs(data.qfrc_inverse - actuators - data.qfrc_applied - friction) / size
    load = max(float((np.abs(one) / size).max(initial=0.0)) for one in (bias, actuators))
    return float(missing.max(initial=0.0)) / max(load, 1e-3 * float(size.max(initial=1.0)))


def after_steps(model: mujoco.MjModel, start: mujoco.MjData) -> float:
    """What is unbalanced after ten seconds of steps, with the friction that could hold subtracted."""
    from cdpr_sim.anymodel.balance import Balance
    from cdpr_sim.anymodel.forces import RestForces

    data, end = copied(model, start), time.monotonic() + STEPPING_TIME
    while data.time < start.time + STEPPED and time.monotonic() < end:
        mujoco.mj_step(model, data)
    if not np.isfinite(data.qpos).all():
        return np.inf
    return Balance(RestForces(model, data), True).at(np.array(data.qpos), [np.arange(model.nv)])[0].of_load


def copied(model: mujoco.MjModel, start: mujoco.MjData) -> mujoco.MjData:
    """Data in the same state."""
    data = mujoco.MjData(model)
    size = mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_INTEGRATION)
    state = np.empty(size)
    mujoco.mj_getState(model, start, state, mujoco.mjtState.mjSTATE_INTEGRATION)
    mujoco.mj_setState(model, data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
    return data


def run(path: Path, steps: bool) -> dict:
    """One model's row, from a process that is ended if it takes too long."""
    ours, theirs = multiprocessing.Pipe()
    process = multiprocessing.get_context("spawn").Process(target=row_of, args=(str(path), theirs, steps))
    process.start()
    theirs.close()
    try:
        row = ours.recv() if ours.poll(LONGEST) else {"agreement": f"no answer within {LONGEST:g} s"}
    except EOFError:
        row = {"agreement": "cannot be read, or its process ended"}
    process.kill()
    process.join()
    return row


def located(source: str, end: str, roots: dict[str, Path]) -> Path | None:
    """A model's file under the root of its source."""
    root = roots.get(source)
    if root is None:
        spec = importlib.util.find_spec(source)
        if spec is None or not spec.submodule_search_locations:
            return None
        root = Path(spec.submodule_search_locations[0])
    found = sorted(root.rglob(f"{end.rpartition('/')[2]}.xml"))
    return next((path for path in found if f"/{end}.xml" in path.as_posix()), None)


def verdict(end: str, row: dict) -> str:
    """right; right, but time steps only stay there; rest by one way; a correct reason; wrong; or not answered."""
    if "way" in row:
        if not row["needs"] < RIGHT or end in WITHOUT_REST:
            return "wrong"
        if row["agreement"] == "agree (beside)":
            return "right, stays"
        return "right" if row["agreement"].startswith(("agree", "was at rest")) else "rest, by one way"
    if end in WITHOUT_REST and WITHOUT_REST[end] in row["agreement"]:
        return "correct reason"
    return "not answered"


def summary(rows: list[dict]) -> list[str]:
    """Counts by source, residuals, times, and what is not answered: as Markdown."""
    words = ["right", "correct reason", "right, stays", "rest, by one way", "not answered", "wrong"]
    lines = [f"| source | models | {' | '.join(words)} |", "|---|" + "---|" * (len(words) + 1)]
    for source in [*MODELS, ""]:
        own = [row["verdict"] for row in rows if f"{source}/" in ("/", row["model"][: len(source) + 1])]
        counts = " | ".join(str(own.count(word)) for word in words)
        lines.append(f"| {source or 'all'} | {len(own)} | {counts} |")
    verdicts = [row["verdict"] for row in rows]
    answered = verdicts.count("right") + verdicts.count("correct reason")
    both = answered + verdicts.count("right, stays")
    rest = [row for row in rows if row["verdict"].startswith("right")]
    moved = [row for row in rest if row["way"] != "start"]
    lines += ["", f"answered: {answered} of {len(rows)}; with those at which time steps only stay {both}"]
    for name, unit, of in (("residual", "", rest), ("needs", "", rest), ("seconds", " s", rows)):
        values = [row[name] for row in of if name in row]
        lines.append(f"{name}: median {np.median(values):.2g}{unit}, largest {max(values):.2g}{unit}")
    left = [not row["step10s"] <= 1e-2 for row in moved if "step10s" in row]
    if left:
        lines.append(
            f"ten seconds of mj_step: more than 1 % is left in {sum(left)} of {len(left)} that were not at rest"
        )
    lines += [f"{row['model']}: {row['agreement']}" for row in rows if row["verdict"] in words[3:]]
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description="Static equilibria of models of others.")
    parser.add_argument("--root", action="append", default=[], metavar="SOURCE=FOLDER")
    parser.add_argument("--only", default="", help="part of a model's path")
    parser.add_argument("--without-steps", action="store_true", help="leave out the ten seconds of mj_step")
    parser.add_argument("--csv", type=Path)
    options = parser.parse_args()
    roots = {name: Path(folder) for name, _, folder in (one.partition("=") for one in options.root)}
    rows, counts = [], {}
    head = f"{'model':44}{'bodies':>7}{'dofs':>5} {'way':8}{'residual':>9}{'time':>6}{'needs':>9}{'10 s':>9}"
    print(f"{head}  verdict: agreement")
    for source, ends in MODELS.items():
        for end in ends.split():
            if options.only not in f"{source}/{end}":
                continue
            path = located(source, end, roots)
            if path is None:
                counts["not found"] = counts.get("not found", 0) + 1
                continue
            row = run(path, not options.without_steps)
            if "unreadable" in row:
                counts["not read"] = counts.get("not read", 0) + 1
                print(f"{source + '/' + end:44.44} this version of MuJoCo cannot read it: {row['unreadable']}")
                continue
            word = verdict(end, row)
            counts[word] = counts.get(word, 0) + 1
            rows.append({"model": f"{source}/{end}", "verdict": word} | row)
            numbers = [f"{row[name]:.1e}" if name in row else "-" for name in ("residual", "needs", "step10s")]
            size = f"{row.get('bodies', '-'):>7}{row.get('dofs', '-'):>5} {row.get('way', '-'):8}{numbers[0]:>9}"
            measured = f"{row.get('seconds', LONGEST):>5.1f}s{numbers[1]:>9}{numbers[2]:>9}"
            print(f"{source + '/' + end:44.44}{size}{measured}  {word}: {row['agreement']}", flush=True)
    print(f"\n{len(rows)} models: {', '.join(f'{count} {word}' for word, count in sorted(counts.items()))}\n")
    print("\n".join(summary(rows)))
    if options.csv:
        with options.csv.open("w", newline="") as file:
            writer = csv.DictWriter(file, COLUMNS)
            writer.writeheader()
            writer.writerows(rows)


if __name__ == "__main__":
    sys.exit(main())
