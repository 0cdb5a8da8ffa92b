"""Studies: the paper's experiments and further ones, computed and drawn."""
