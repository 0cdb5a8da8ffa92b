"""Analysis by statics: sensitivities, modes, all equilibria, compensation, identification, whole workspaces."""
