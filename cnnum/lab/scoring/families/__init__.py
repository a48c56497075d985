"""Families of scenes: how an object is pulled, its kind, the cover, the taxels, and holding.

`catalogue` lists all. Spheres and hands are those of `cnnum.drivers.simulated.grips` and `hands`;
`faces` are other bodies, and `dragged` pulls them.
"""
