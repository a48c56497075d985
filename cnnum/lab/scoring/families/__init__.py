"""Families of scenes: how an object is pulled, its kind, the cover, the taxels, and holding.

The way of a scene: `draw` → `pulls` or `held` → `spheres` or `faces` and `dragged` →
`taxel_effects` → a trial. `draw` gives numbers by seed, `pulls` the hand. `spheres` go by the
simulated `arrays`. `catalogue` lists all.
"""
