"""Static equilibrium of any MuJoCo model: forces at rest, motion with kinetic damping, Newton's method, friction."""
