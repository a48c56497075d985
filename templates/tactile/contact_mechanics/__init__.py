"""Estimators that fit contact mechanics: spheres, punches, pulls and torques, and how they grow."""
