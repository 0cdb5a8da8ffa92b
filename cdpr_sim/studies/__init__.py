"""The paper's experiments and ours, by name: computed, then drawn."""
