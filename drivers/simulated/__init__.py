"""A simulated taxel array: a body pressed, pulled and twisted on the elastic cover.

The way of a frame: `script` (the hand's movements) → `motion` (load and movement in time) →
`springs` and `tractions` (a sphere's friction, with its history, and what it does to the surface),
or `bodies` (both, of other faces) → `influence` (strain at the taxels under a `cover`, with `bumps`
or as a `layer`) → `creep` → bridge voltages. `array` is the driver, `settings` the options of a
scene.
"""
