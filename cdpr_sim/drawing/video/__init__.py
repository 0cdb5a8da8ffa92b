"""Films of given trajectories."""
