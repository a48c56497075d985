"""The dissertation's tables, figures and equations, chapter by chapter."""
