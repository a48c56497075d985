"""Transports: where bytes come from, when it is no serial port."""
