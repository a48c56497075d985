"""A simulated taxel array: a sphere pressed, pulled and twisted on the elastic cover.

The way of a frame: `script` (the hand's movements) → `motion` (load and movement in time) →
`springs` (friction, with its history) → `tractions` (on the surface) → `influence` (strain at the
taxels under a `cover`, with `bumps` or as a `layer`) → `creep` → bridge voltages. `array` is the
driver, `settings` the options of a scene.
"""
