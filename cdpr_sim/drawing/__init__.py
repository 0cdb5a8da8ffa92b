"""Pictures of given results. Computes nothing."""
