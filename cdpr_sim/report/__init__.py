"""Results for people: tables and JSON."""
