"""Both roads, compared."""
