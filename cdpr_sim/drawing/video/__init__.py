"""Videos of given trajectories."""
