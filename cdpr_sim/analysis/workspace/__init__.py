"""Whole workspaces: grids, feasibility, sweeps and their stores."""
