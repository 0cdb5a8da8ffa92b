"""Shared data types: robots, problems, equilibria, and the checks, errors and files that all folders use."""
