"""The live view: an array's frames and their results, in a browser page."""
