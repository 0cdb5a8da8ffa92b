"""Experiments that only the scripts of this folder run: computation, figure and tables, without a command."""
