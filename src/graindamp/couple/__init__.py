"""couple."""
