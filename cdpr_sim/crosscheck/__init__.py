"""Both methods, compared."""
