"""One equilibrium by mathematics. Never MuJoCo."""
