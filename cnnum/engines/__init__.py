"""Engines: each builds and runs a schedule on its own kind of machine."""
