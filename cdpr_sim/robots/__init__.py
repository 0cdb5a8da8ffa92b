"""Robots by name, from robot files and from other projects' files."""
