"""The elastic cover as cellular arrays: half-space, depth layers, deconvolution."""
