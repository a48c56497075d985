"""Codecs, which convert the bytes of one kind of array to scans and back, without any port."""
