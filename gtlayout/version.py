"""What this version is called; quick to import."""

__version__ = "0.1.0"
