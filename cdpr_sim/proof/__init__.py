"""Proofs by interval arithmetic: of an equilibrium, and of all. Uses data of ``core`` and no formula of the solvers."""
