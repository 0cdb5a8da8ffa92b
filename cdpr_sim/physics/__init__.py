"""MuJoCo: models, settling, driving, releasing. Never a formula of statics."""
