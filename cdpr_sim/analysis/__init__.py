"""What follows from statics: sensitivities, modes, all equilibria, compensation, identification, whole workspaces."""
