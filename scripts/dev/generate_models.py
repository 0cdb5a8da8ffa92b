"""Generate models/, or check with --check that models/ is up to date.

Run: python scripts/dev/generate_models.py [--check]
"""

import sys

from cdpr_sim.cli import app

if __name__ == "__main__":
    app(["models", "-o", "models", "--winches", *(sys.argv[1:] or ["--force"])])
