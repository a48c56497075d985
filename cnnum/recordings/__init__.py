"""Recordings that survive: chunks of frames in MCAP files, each with a checksum.

`journal` writes them while frames come, and `scan` finds the whole ones again. `index` closes a
file, `reader` gives the frames back, and `export` turns them into other files.
"""
