"""Comparison of statics and MuJoCo."""
