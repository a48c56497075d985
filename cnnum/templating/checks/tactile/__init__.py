"""Answers of the tactile programs: closed forms of contact mechanics and of the half-space."""
