"""The version of the package; files that it writes and caches that it keeps bear it."""

__version__ = "0.1.0"
