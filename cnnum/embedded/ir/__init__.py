"""Statements on whole numbers, and on reals: records that the emulator runs and printers write."""
