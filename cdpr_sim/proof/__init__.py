"""Proofs by interval arithmetic: of one equilibrium, and of all; from ``core``'s data, without solvers' formulas."""
