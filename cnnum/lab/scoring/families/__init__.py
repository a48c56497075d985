"""Families of scenes: how an object is pulled, its kind, the cover, the taxels, and holding.

The way of a scene: `draw` (numbers by seed) → `pulls` (the hand) or `held` → `spheres` (by the
simulated `arrays`) or `faces` and `dragged` → `taxel_effects` → a trial. `catalogue` lists all.
"""
