"""Scenes that come with the package."""
