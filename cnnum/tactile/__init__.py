"""Closed forms of tactile sensing: the elastic cover, its contacts and the taxels under it.

The modules ``halfspace``, ``contact``, ``inverse``, ``taxel``, ``texture`` and ``pad`` take and
return arrays in SI units. None of them imports an engine, so that they can serve to check one.
"""
