"""Sentences on standard error that are no errors: which engine or device is used instead."""

import logging
from functools import cache


@cache
def say_once(sentence: str) -> None:
    """Say a sentence once a process: programs make many engines.

    It goes to the logger "cnnum", which writes to standard error unless a program says otherwise.
    """
    logging.getLogger("cnnum").warning(sentence)
