"""The structure that vibrates: its modes and frequency responses."""
