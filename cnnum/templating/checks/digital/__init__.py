"""Answers by digital definitions: neighbourhoods, ranks, propagation, motion, life."""
