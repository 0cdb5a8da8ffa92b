"""Better layouts: what may move, what is good, what must hold, and the search for it."""
