"""Parts that tactile programs share: loads above rest, patches, latches, pressure."""
