"""Tactile templates, and the analogic programs built from them, one module per program."""
