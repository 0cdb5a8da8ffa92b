"""Robots out of the files of other projects: one module per format, ``reading`` and ``draft`` for all of them."""
