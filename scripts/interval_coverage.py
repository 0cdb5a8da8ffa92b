"""How often the 95 % intervals of ``identify`` hold the true values, over simulated measurements of IRMA4U."""

import sys

from studies.coverage import CASES, described, fitted, held

FITS = 80  # per case
LEAST, MOST = 0.93, 0.97


def main() -> None:
    wrong = False
    for case in CASES:
        holds = held(fitted(case, FITS))
        print(f"errors {case:8s} {FITS} fits: {described(holds)}", flush=True)
        wrong |= not LEAST <= holds.mean() <= MOST
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
