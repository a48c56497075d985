"""Tactile templates, and the analogic programs that are made of them: one module a program."""
