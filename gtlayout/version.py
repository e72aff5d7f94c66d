"""The version; quick to import."""

__version__ = "0.1.0"
