"""Robots by name, and from files."""
