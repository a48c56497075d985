"""Codecs: bytes of one kind of array to scans and back, apart from ports and sockets."""
