"""Figures and videos of given results; nothing is computed here."""
