"""Closed forms of tactile sensing: the elastic cover, its contacts and the taxels under it.

Each room is array-in array-out and SI: ``halfspace``, ``contact``, ``inverse``, ``taxel``,
``texture``, ``pad``. None of them imports an engine, so each can judge one.
"""
