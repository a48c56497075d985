"""A signal never breaks into shielded work, and is not lost either."""

import signal

import pytest

from cnnum.cli.signals import stoppable, undisturbed


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_what_is_shielded_comes_to_its_end_first(number):
    # the suite may run where a signal is ignored, as under nohup
    mine = {signal.SIGINT: signal.default_int_handler, signal.SIGHUP: signal.SIG_DFL}
    before = {known: signal.signal(known, handler) for known, handler in mine.items()}
    done = []
    try:
        with pytest.raises(KeyboardInterrupt), stoppable() as stop:  # noqa: PT012
            with stop.shield():
                signal.raise_signal(number)
                done.append("half")
                done.append("whole")
            done.append("too far")
    finally:
        for known, handler in before.items():
            signal.signal(known, handler)
    assert done == ["half", "whole"]


def test_elsewhere_it_ends_the_block_at_once():
    done = []
    with pytest.raises(KeyboardInterrupt), stoppable():  # noqa: PT012
        signal.raise_signal(signal.SIGTERM)
        done.append("too far")
    assert not done


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGHUP])
def test_what_the_parent_ignores_stays_ignored(number):
    before = signal.signal(number, signal.SIG_IGN)
    try:
        with stoppable():
            signal.raise_signal(number)
    finally:
        signal.signal(number, before)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_file_is_finished_undisturbed(number):
    with undisturbed():
        signal.raise_signal(number)
