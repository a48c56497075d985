"""The live view: what an array sends and what comes of it, in a browser page."""
