"""graindamp: predict and design particle dampers."""

__version__ = "0.1.0"
