"""Robots from files of other projects: one module per format; all use ``documents`` and ``draft``."""
