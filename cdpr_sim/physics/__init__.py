"""MuJoCo: models, settling, driving, tracking and releasing, without formulas of statics."""
