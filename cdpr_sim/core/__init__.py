"""What is asked and what is answered: robots, problems, equilibria, and the words that all rooms share."""
