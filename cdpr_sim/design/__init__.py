"""Layout optimisation: variables, objectives, constraints and search."""
