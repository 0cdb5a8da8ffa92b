import shutil
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from rich.progress import Progress

import cdpr_sim as cdpr
from cdpr_sim.analysis.workspace import store as stores
from cdpr_sim.analysis.workspace import sweep as sweeping
from cdpr_sim.analysis.workspace.sweep import QUANTITIES
from cdpr_sim.core.status import Status
from cdpr_sim.crosscheck import settled_quantities
from cdpr_sim.crosscheck.check import COMPARED, OUTCOMES
from cdpr_sim.statics.newton_kernel import FORCE_TOLERANCE

GRID = (7, 5, 4)

BALANCE = 2 * FORCE_TOLERANCE
"""Two solutions of one problem, whose rest lengths differ in the last place, may each leave that fraction of the load
unbalanced; divided by the smallest eigenvalue it is a distance."""

TENSION = 1e-6
"""[N] 1e-8 measured."""


@pytest.fixture(scope="module")
def dataset() -> xr.Dataset:
    """Two layouts, two materials."""
    return cdpr.sweep(["parallel", "cogiro"], GRID, ["vectran-0.7mm", "fishing-0.4mm"])


def test_every_variable_has_its_dimensions_units_and_meaning(dataset):
    """The grid's, plus cables, modes or axes; units in the attributes, readable by any tool for NetCDF."""
    for name, kind in QUANTITIES.items():
        assert dataset[name].dims == ("robot", "material", "x", "y", "z", *kind.dims)
        assert dataset[name].attrs["units"] == kind.units
        assert dataset[name].attrs["long_name"]
    assert dataset["feasible"].dims == ("robot", "x", "y", "z")
    assert all(dataset[name].attrs["units"] == "m" for name in "xyz")
    assert dataset.sizes == {
        "robot": 2, "material": 2, "x": 7, "y": 5, "z": 4, "axis": 3, "cable": 8, "mode": 6, "corner": 2
    }  # fmt: skip


@pytest.mark.parametrize("suffix", [".nc", ".zarr"])
def test_a_store_alone_says_what_was_computed(tmp_path, suffix):
    """Mass, cables, exits, anchors, conditions, and the robots in full: from the file, each can be solved again."""
    crane = cdpr.load_robot("ipanema-1").replace(name="crane", inertia=(1, 2, 3), frame=[(-3, -3, 0), (3, 3, 4)])
    pulleys = cdpr.Robot(
        crane.exits[:7], crane.anchors[:7], [*range(70_000, 77_000, 1000)], mass=7.0,
        pulley_radius=0.02, stiffening=(9.0, 0.0), frame=crane.frame, workspace=crane.workspace, name="pulleys",
    )  # fmt: skip
    robots = {"crane": crane, "pulleys": pulleys}
    pull = [1.0, 2, 3, 0.1, 0.2, 0.3]
    grid = {"x": [0.0], "y": [0.0], "z": [1.0, 1.2]}
    asked = dict(orientation=(0.01, 0, 0), external_wrench=pull, wrenches=[[9.0, 0, 0, 0, 0, 0]])
    cdpr.sweep(list(robots.values()), grid, **asked, store=tmp_path / f"sweep{suffix}")
    stored = cdpr.open_sweep(tmp_path / f"sweep{suffix}").compute()
    assert stored.attrs["external_wrench"] == pytest.approx(pull, rel=0, abs=0)
    assert stored.attrs["orientation"] == pytest.approx([0.01, 0, 0], rel=0, abs=0)
    assert stored["wrenches"].values.tolist() == asked["wrenches"]
    for name, robot in robots.items():
        one = stored.sel(robot=name, cable=slice(1, robot.cables))
        for field in ("exits", "anchors", "axial_stiffness", "linear_density", "mass", "frame"):
            np.testing.assert_array_equal(one[field], getattr(robot, field, robot.cabling.linear_density), field)
            assert one[field].attrs["units"]
        assert str(one["material"].values) == (robot.material or "EA = 70 kN to 76 kN")
        (tmp_path / "again.toml").write_text(str(one["robot_file"].values), encoding="utf-8")
        again = cdpr.load_robot(str(tmp_path / "again.toml"))
        equilibrium = cdpr.solve(again, [0, 0, 1.2, 0.01, 0, 0], external_wrench=pull)
        found = one.isel(x=0, y=0, z=1)
        np.testing.assert_allclose(equilibrium.tensions, found["tensions"], rtol=1e-6, atol=0, err_msg=name)


def test_sweep_is_solve_pose_by_pose(dataset):
    """Every quantity, against the one-pose solver and its Equilibrium, at a sample over the workspace."""
    rng, compared = np.random.default_rng(1), 0
    for _ in range(25):
        place = {name: int(rng.integers(dataset.sizes[name])) for name in ("robot", "material", "x", "y", "z")}
        one = dataset.isel(place)
        robot = cdpr.load_robot(str(one["robot"].values)).replace(material=str(one["material"].values))
        equilibrium = cdpr.solve(robot, [float(one[name]) for name in "xyz"])
        if not equilibrium.stable:
            continue  # where a rotation is free, rounding decides it
        compared += 1
        softest = BALANCE * robot.weight / equilibrium.eigenvalues[0]
        turned = softest / robot.characteristic_length
        np.testing.assert_allclose(one["position"], equilibrium.position, rtol=0, atol=softest)
        np.testing.assert_allclose(one["deviation"], equilibrium.deviation, rtol=0, atol=softest)
        np.testing.assert_allclose(one["distance"], np.linalg.norm(equilibrium.deviation), rtol=0, atol=softest)
        np.testing.assert_allclose(one["tilt"], equilibrium.tilt, rtol=0, atol=turned)
        np.testing.assert_allclose(one["rotation_vector"], equilibrium.rotation.as_rotvec(), rtol=0, atol=turned)
        np.testing.assert_allclose(one["tensions"], equilibrium.tensions, rtol=0, atol=TENSION)
        np.testing.assert_allclose(one["eigenvalues"], equilibrium.eigenvalues, rtol=1e-6, atol=1e-6)
        assert int(one["slack_count"]) == equilibrium.slack.sum()
        slack = [bool(int(one["slack_set"]) >> i & 1) for i in range(robot.cables)]
        np.testing.assert_array_equal(slack, equilibrium.slack)
        assert int(one["status"]) == 0
        assert bool(one["feasible"]) == cdpr.feasible(robot, equilibrium.problem.pose.translation)
    assert compared >= 20


def test_chunks_change_no_bit(dataset):
    """Any chunking by Dask, and none at all, give the same numbers."""
    asked = dict(robots=["parallel", "cogiro"], materials=["vectran-0.7mm", "fishing-0.4mm"])
    for chunk in (30, None):
        xr.testing.assert_identical(cdpr.sweep(**asked, grid=GRID, chunk=chunk), dataset)
    few = cdpr.sweep(**asked, grid=(3, 2, 2), chunk=None)
    xr.testing.assert_identical(cdpr.sweep(**asked, grid=(3, 2, 2), chunk=1), few)  # a task per pose


def test_lazy_sweep_computes_nothing_until_asked(dataset):
    """``compute=False`` gives Dask arrays, at once, of any size; a part of it is computed alone."""
    lazy = cdpr.sweep("cogiro", (200, 200, 200), compute=False)
    assert lazy["tilt"].size == 200**3
    assert lazy["tilt"].chunks is not None
    corner = lazy.isel(x=slice(0, 1), y=slice(0, 1), z=slice(0, 4)).compute()
    # At parallel's corner the platform is neutrally stable, and its rotation is known to rounding over rounding.
    np.testing.assert_allclose(corner["tilt"][0, 0, 0], dataset["tilt"][1, 0, 0, 0, 0], rtol=0, atol=1e-9)


def test_single_robot_has_no_dimension_of_its_own():
    """One robot and no materials: just x, y, z, with the robot's name as a coordinate."""
    dataset = cdpr.sweep("cogiro", (2, 2, 2))
    assert dataset["tilt"].dims == ("x", "y", "z")
    assert (str(dataset["robot"].values), str(dataset["material"].values)) == ("cogiro", "vectran-0.7mm")


def test_robots_of_different_cables_are_padded_with_nan():
    """A cable that a robot does not have has no tension, not even zero."""
    dataset = cdpr.sweep(["two-cable", "planar-vertical"], (3, 1, 2))
    tensions = dataset["tensions"].sel(robot="two-cable")
    assert np.isnan(tensions.sel(cable=[3, 4])).all()
    assert np.isfinite(tensions.sel(cable=[1, 2])).all()
    assert np.isfinite(dataset["tensions"].sel(robot="planar-vertical")).all()


def test_pose_that_cannot_be_solved_is_nan_with_a_status():
    """Above its exits the platform falls: no number anywhere, and the reason is there; below, all is as ever."""
    dataset = cdpr.sweep("parallel", {"z": [0.2, 0.4, 0.6, 0.8]})
    np.testing.assert_array_equal(dataset["status"].squeeze(), [0, 0, Status.FALLS, Status.FALLS])
    meanings = dict(
        zip(dataset["status"].attrs["flag_values"], dataset["status"].attrs["flag_meanings"].split(), strict=True)
    )
    assert meanings == {
        -1: "pending", 0: "converged", 1: "iteration_limit", 2: "stalled", 3: "not_finite", 4: "falls",
        7: "overstrained", 8: "off_wheel", 10: "no_pretension",
    }  # fmt: skip
    lost = dataset.isel(z=[2, 3])
    for name, kind in QUANTITIES.items():
        if kind.dtype is float:
            assert np.isnan(lost[name]).all(), name
            assert np.isfinite(dataset.isel(z=[0, 1])[name]).all(), name
    assert (lost["slack_set"] == -1).all()


def test_a_sweep_falls_where_solve_refuses():
    """Level, turned, and pulled up by a wrench, on both sides of the height where all exits lie below."""
    robot = cdpr.load_robot("parallel")
    lift = [0, 0, 2 * robot.weight, 0, 0, 0]
    heights = np.linspace(0.4, 0.6, 9)
    borders = []
    for orientation, wrench in (((0, 0, 0), None), ((0.2, 0.4, 0), None), ((0, 0, 0), lift)):
        dataset = cdpr.sweep(robot, {"z": heights}, orientation=orientation, external_wrench=wrench, chunk=None)
        falls = dataset["status"].values.squeeze() == Status.FALLS
        borders.append(int(falls.sum()))
        for height, found in zip(heights, falls, strict=True):
            try:
                cdpr.Problem.of(robot, (0.4, 0.25, height, *orientation), external_wrench=wrench)
                refused = False
            except cdpr.InvalidInput as error:
                refused = "falls" in str(error)
            assert found == refused
    assert borders == [6, 5, 0]


def test_solver_that_gives_up_leaves_nan_and_its_status(monkeypatch):
    """What the solver did not certify never reaches the Dataset."""
    solve_many = sweeping.solve_many

    def stalled(*args, **kwargs):
        equilibria = solve_many(*args, **kwargs)
        status = equilibria.status.copy()
        status[..., 0] = Status.STALLED
        return replace(equilibria, status=status)

    monkeypatch.setattr(sweeping, "solve_many", stalled)
    dataset = cdpr.sweep("cogiro", (2, 2, 3), chunk=None)
    assert (dataset["status"].isel(z=0) == Status.STALLED).all()
    assert np.isnan(dataset["tilt"].isel(z=0)).all()
    assert np.isfinite(dataset["tilt"].isel(z=[1, 2])).all()


def test_quantities_limit_what_is_computed(dataset):
    """Only what is asked for, and always the status."""
    small = cdpr.sweep(["parallel", "cogiro"], GRID, ["vectran-0.7mm", "fishing-0.4mm"], quantities=["tilt"])
    assert set(small.data_vars) == {"tilt", "status"}
    xr.testing.assert_equal(small["tilt"], dataset["tilt"])


def test_the_wrenches_that_may_come_add_to_the_one_that_is_there():
    """A push to the right that one to the left makes up for, and the other way round."""
    robot, right = cdpr.load_robot("cogiro"), np.array([1.5, 0, 0, 0, 0, 0])
    asked = {"quantities": ["feasible"], "tension_limits": (0, 10)}
    weight_alone = cdpr.sweep(robot, (6, 5, 4), **asked)["feasible"].values
    both = cdpr.sweep(robot, (6, 5, 4), external_wrench=right, wrenches=-right, **asked)
    np.testing.assert_array_equal(both["wrench_feasible"], weight_alone)
    assert (both["feasible"].values != weight_alone).any()


def test_cluster_of_processes_computes_the_same_sweep(tmp_path):
    """A real local cluster: once a Client is connected, nothing else changes, in memory and into Zarr."""
    distributed = pytest.importorskip("distributed")
    asked = dict(robots=["parallel", "cogiro"], grid=(3, 2, 2), chunk=6)
    here = cdpr.sweep(**asked, compute=False).compute(scheduler="synchronous")
    with (
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=1, processes=True, dashboard_address=":0", local_directory=str(tmp_path)
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        counted = []
        there = cdpr.sweep(**asked)
        counted += client.run(lambda dask_worker: dask_worker.state.executed_count).values()
        stored = cdpr.sweep(**asked, quantities=["tilt"], store=tmp_path / "sweep.zarr").compute()
        counted += client.run(lambda dask_worker: dask_worker.state.executed_count).values()
    assert 0 < counted[0] < counted[1]
    xr.testing.assert_identical(there, here)
    xr.testing.assert_equal(stored, cdpr.sweep(**asked, quantities=["tilt"]))


def test_tasks_are_neither_too_large_nor_too_few():
    """At most CHUNK poses each; several even in a sweep of ten thousand."""
    for counts in ((40, 25, 10), (200, 100, 50), (3, 2, 2), (1, 1, 10**6), (7, 10**5, 1)):
        axes = {name: np.arange(count) for name, count in zip("xyz", counts, strict=True)}
        blocks = sweeping._blocks(axes, 1, sweeping.CHUNK)
        assert np.prod(list(blocks.values())) <= sweeping.CHUNK, counts
        tasks = np.prod([-(-len(axes[name]) // blocks[name]) for name in axes])
        assert tasks >= min(4, np.prod(counts) // sweeping.LEAST_CHUNK), counts


def test_sweep_over_poses_is_the_one_of_a_grid_at_each():
    """Each with its own orientation, for several robots and materials."""
    poses, materials = [(0.3, 0.25, 0.1), (0.4, 0.25, 0.1, 0.05, -0.03, 0.1)], ["vectran-0.7mm", "fishing-0.4mm"]
    robots, loads = ["parallel", "cogiro"], {"external_wrench": (0, 0, -1, 0, 0, 0), "wrenches": [(1, 0, 0, 0, 0, 0)]}
    along = cdpr.sweep(robots, materials=materials, poses=poses, **loads)
    assert dict(along["tilt"].sizes) == {"robot": 2, "material": 2, "pose": 2}
    for row, pose in enumerate(poses):
        grid = dict(zip("xyz", np.array(pose[:3])[:, None], strict=True))
        turn = {"orientation": pose[3:] or (0, 0, 0)}
        single = cdpr.sweep(robots, grid, materials, **turn, **loads).isel(x=0, y=0, z=0)
        for name in single.data_vars:
            np.testing.assert_array_equal(along[name].isel(pose=row), single[name], err_msg=str(name))
    assert along["z"].isel(pose=1) == 0.1


SETTLED = dict(robots=["parallel", "cogiro"], grid=(3, 2, 2), quantities=["position", "settled"])


def test_a_sweep_settles_and_compares_every_pose():
    """By Dask in many blocks: the numbers of ``settle_many``, to the bit, and the outcomes and errors of ``check``."""
    materials = ["vectran-0.7mm", "fishing-0.4mm"]
    swept, checked = (
        cdpr.sweep(**SETTLED, materials=materials, chunk=8),
        cdpr.check(["parallel", "cogiro"], (3, 2, 2), materials),
    )
    for name in ("outcome", *COMPARED):
        xr.testing.assert_equal(
            swept[name].drop_vars(list(swept[name].coords)),
            checked.dataset[name].drop_vars(list(checked.dataset[name].coords)),
        )
    robot = cdpr.load_robot("cogiro").replace(material="fishing-0.4mm")
    one = swept.sel(robot="cogiro", material="fishing-0.4mm")
    poses = np.stack(np.meshgrid(swept["x"], swept["y"], swept["z"], indexing="ij"), axis=-1).reshape(-1, 3)
    settled = cdpr.settle_many(robot, poses)
    np.testing.assert_array_equal(one["settled_position"].values.reshape(-1, 3), settled.positions)
    np.testing.assert_array_equal(one["settled_tensions"].values.reshape(-1, 8), settled.tensions)
    for name, kind in settled_quantities.QUANTITIES.items():
        assert swept[name].dims == ("robot", "material", "x", "y", "z", *kind.dims)
        assert swept[name].attrs["units"] == kind.units
    # In one call, at poses, where one falls: the same numbers; what is unknown is nan, and says why.
    at = cdpr.sweep(robot, poses=[*poses, (0.4, 0.25, 10)], quantities=["settled"])
    np.testing.assert_array_equal(at["settled_position"].values[:-1], settled.positions)
    assert np.isnan(at["settled_tensions"].values[-1]).all()
    assert at["settled_status"].values[-1] == Status.FALLS
    assert OUTCOMES[int(at["outcome"].values[-1])] == "refused"


def test_a_sweep_that_cannot_fit_is_refused_and_one_into_a_store_is_not(tmp_path, monkeypatch):
    """By the memory there is; by the disk where it goes there; never where nothing is computed."""
    monkeypatch.setattr(sweeping.free_ram, "available", lambda: 1e6)
    with pytest.raises(cdpr.InvalidInput, match=r"10,000 poses would take about .* MB of memory, and 1 MB are"):
        cdpr.sweep("cogiro")
    with pytest.raises(cdpr.InvalidInput, match="expected fewer poses"):
        cdpr.check("cogiro")
    cdpr.sweep("cogiro", compute=False)
    asked = dict(grid=(10, 10, 10), quantities=["tilt"])
    cdpr.sweep("cogiro", **asked)
    monkeypatch.setattr(sweeping.free_ram, "available", lambda: 1e4)
    with pytest.raises(cdpr.InvalidInput, match="1,000 poses would take"):
        cdpr.sweep("cogiro", **asked)
    assert cdpr.sweep("cogiro", **asked, store=tmp_path / "sweep.zarr").sizes["x"] == 10
    monkeypatch.setattr(sweeping.shutil, "disk_usage", lambda _: shutil._ntuple_diskusage(10**9, 10**9, 10**5))
    with pytest.raises(cdpr.InvalidInput, match="are free in"):
        cdpr.sweep("cogiro", store=tmp_path / "other.zarr")


@pytest.mark.parametrize(("suffix", "copies"), [(None, 0), (".nc", 1)])
def test_the_memory_that_is_asked_for_is_that_of_the_result(suffix, copies, tmp_path, monkeypatch):
    """As many copies of it as are made, and one more for a NetCDF file; of many robots, and of one quantity."""
    said: list[float] = []
    monkeypatch.setattr(sweeping.free_ram, "refuse_beyond", lambda what, need, instead: said.append(need))
    settled = dict(grid=(1, 1, 2), quantities=["tensions", "settled"])
    for number, asked in enumerate((dict(quantities=["tilt"]), dict(robots=["cogiro", "parallel"]), settled)):
        store = tmp_path / f"{number}{suffix}" if suffix else None
        result = cdpr.sweep(**({"robots": "cogiro", "grid": (2, 2, 2), "store": store} | asked))
        poses = result["status"].size
        own = sum(one.nbytes for one in result.data_vars.values() if one.sizes.keys() & {"x", "y", "z"})
        assert said[-1] == pytest.approx((sweeping.MEMORY_COPIES + copies) * own, abs=2 * poses * 3)


TINY = dict(robots="two-cable", quantities=["tilt"], chunk=1, progress=True)

BARS: dict[str, tuple[Callable, list[str]]] = {
    "a sweep": (lambda here: cdpr.sweep(**TINY, grid=(2, 1, 2)), ["sweep"]),
    "a stored sweep": (
        lambda here: [cdpr.sweep(**TINY, grid=(2, 1, 2), store=here / "s.zarr") for _ in "12"],
        ["sweep into s.zarr", "check of s.zarr", "sweep into s.zarr"],
    ),
    "check": (lambda here: cdpr.check(["two-cable", "planar-vertical"], (2, 1, 2), progress=True), ["check"]),
    "certify_all": (
        lambda here: cdpr.certify_all(cdpr.Problem.of(cdpr.load_robot("two-cable"), (0.2, 0, 0.1)), progress=True),
        ["looking for equilibria"],
    ),
}


@pytest.mark.parametrize("name", BARS)
def test_progress_bars_end_where_they_are_full(name, tmp_path, monkeypatch):
    """They advance step by step, each with its own words, and end with the work."""
    call, labels = BARS[name]
    monkeypatch.setattr(stores, "TASKS", 2)  # two slabs
    bars: list[list] = []

    def add(self, what, total):
        bars.append([what, total, 0.0])
        return len(bars) - 1

    def advance(self, task, amount):
        bars[task][2] += amount

    monkeypatch.setattr(Progress, "add_task", add)
    monkeypatch.setattr(Progress, "advance", advance)
    call(tmp_path)
    assert [what for what, *_ in bars] == labels
    for what, total, done in bars:
        assert done == pytest.approx(total, rel=1e-6), what


def test_more_cables_than_bits_are_not_told_apart_wrongly():
    """``slack_set`` of 64 cables would overflow."""
    angles = np.linspace(0, 2 * np.pi, 70, endpoint=False)
    ring = np.column_stack([np.cos(angles), np.sin(angles), np.full(70, 2.0)])
    robot = cdpr.Robot(ring, 0.1 * ring - [0, 0, 0.2], 1e4, 1.0)
    with pytest.raises(cdpr.InvalidInput, match="slack_set has bits for 63 cables at most, and 'robot' has 70"):
        cdpr.sweep(robot, (2, 1, 1))
    assert cdpr.sweep(robot, (2, 1, 1), quantities=["tilt"]).sizes["x"] == 2
