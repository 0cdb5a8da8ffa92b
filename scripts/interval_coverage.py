"""How often the 95 % intervals of ``identify`` hold the true values, over simulated measurements of IRMA4U."""

import sys

from studies.coverage import CASES, coverage, described

FITS = 80  # per case
LEAST, MOST = 0.93, 0.97


def main() -> None:
    wrong = False
    for case in CASES:
        held = coverage(case, FITS)
        print(f"errors {case:8s} {FITS} fits: {described(held)}", flush=True)
        wrong |= not LEAST <= held.mean() <= MOST
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
