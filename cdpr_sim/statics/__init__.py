"""Static equilibria by mathematics, without MuJoCo."""
