"""signals/readers."""
