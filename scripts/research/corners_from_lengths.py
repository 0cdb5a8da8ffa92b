"""How well corners are found from belt lengths alone: 200 simulated machines in MuJoCo, read with an error.

Of each machine the corners are displaced; its sled is driven to a grid of places that nobody measures, by rest lengths
that hold it with about the pull of its calibration, and MuJoCo settles it. Read are the lengths of all belts, with an
error, and the tensions of the two lower ones. Printed: errors of the corners, how often intervals contain the truth,
and the errors of a fit with rigid belts to the same rows.
"""

import argparse

import numpy as np

import cdpr_sim as cdpr

DRAWS = 200
DISPLACED = 0.02  # m, largest displacement of each coordinate of a corner
NOISE = 0.5e-3  # m, standard error of a length
PULL = 156.96  # N, MaslowCNC/Maslow_4, pull request 1060
GRID = 5  # places along each axis
ENOUGH = 1.5e-3  # m, error of a corner's coordinate that is to be kept
COVERAGE = 0.95


def main() -> None:
    """Fit each machine, and print the statistics."""
    options = argparse.ArgumentParser(description="How well corners are found from belt lengths alone.")
    options.add_argument("--draws", type=int, default=DRAWS)
    draws, believed, random = options.parse_args().draws, cdpr.load_robot("maslow-4"), np.random.default_rng(0)
    low, high = believed.workspace
    grid = np.array(
        [(x, 0.0, z) for x in np.linspace(low[0], high[0], GRID) for z in np.linspace(low[2], high[2], GRID)]
    )
    errors, rigid, inside, sizes, names, gauge = [], [], [], [], (), ()
    for _ in range(draws):
        moved = random.uniform(-DISPLACED, DISPLACED, believed.exits.shape) * [1, 0, 1]
        moved[2], moved[3, 2] = 0, 0  # the lower left corner is the origin, and the lower right one lies beside it
        true = believed.replace(exits=believed.exits + moved)
        pulled = true.replace(pretension=PULL)
        rest = np.array([pulled.rest_lengths(place) for place in grid])
        settled = cdpr.settle_many(true, grid, rest)
        lengths = rest + NOISE * random.normal(size=rest.shape)
        tensions = np.where([False, False, True, True], settled.tensions, np.nan)
        found = cdpr.identify(
            believed, cdpr.Measurements.of(lengths=lengths, tensions=tensions), ["exits"], length_error=NOISE
        )
        without = cdpr.identify(believed, cdpr.Measurements.of(lengths=lengths), ["exits"], length_error=NOISE)
        truth = [true.exits[int(name.split()[1]) - 1, "xyz".index(name[-1])] for name in found.names]
        errors.append(found.values - truth)
        rigid.append(without.values - truth)
        lower, upper = found.intervals(COVERAGE).T
        inside.append((lower <= truth) & (truth <= upper))
        sizes.append(found.standard_errors)
        names, gauge = found.names, found.gauge
    errors, rigid, inside = np.array(errors), np.array(rigid), np.array(inside)
    worst = np.abs(errors).max(1)
    print(f"{draws} machines, {len(grid)} rows each, {1e3 * NOISE:g} mm of noise, gauge {', '.join(gauge)}")
    for k, name in enumerate(names):
        print(
            f"{name}: root mean square error {1e3 * np.sqrt((errors[:, k] ** 2).mean()):.3f} mm, said "
            f"{1e3 * np.mean(sizes, axis=0)[k]:.3f} mm, rigid belts {1e3 * np.sqrt((rigid[:, k] ** 2).mean()):.3f} mm"
        )
    print(f"coordinates within {1e3 * ENOUGH:g} mm: {(np.abs(errors) < ENOUGH).mean():.1%}")
    within = f"{(worst < ENOUGH).mean():.1%}; worst {1e3 * worst.max():.2f} mm"
    print(f"machines with all coordinates within {1e3 * ENOUGH:g} mm: {within}")
    spread = np.sqrt(COVERAGE * (1 - COVERAGE) / draws)
    print(f"{COVERAGE:.0%} intervals contain the truth in {inside.mean():.1%} (one coordinate varies by {spread:.1%})")
    factor = np.sqrt((rigid**2).mean() / (errors**2).mean())
    print(f"rigid belts: errors {factor:.2f} times as large; mean error {1e3 * rigid.mean(0).round(5)} mm")


if __name__ == "__main__":
    main()
