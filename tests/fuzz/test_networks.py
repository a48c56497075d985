"""No stated error is below the true one: random networks against SciPy with its own equation.

A short run takes some networks of one seed. A long one goes on through the seeds until its time is
over, and prints its account. Other shards: `python tests/helpers/random_networks.py SEED COUNT`.
"""

import os
import time
import warnings
from dataclasses import replace

import numpy as np
import pytest
from random_networks import OPPOSITE, SYMMETRIC, Account, Network, Truth, judged, network_of

import cnnum

FEW = 20
"""Networks of a short run; their truth takes most of its seconds."""

SECONDS = float(os.environ.get("CNNUM_FUZZ", "0"))

ONE_IN = 1000
"""Of the errors of a long run, at most one in so many may be below the true one."""


def test_no_error_is_below_the_true_one():
    engines = [cnnum.Engine("numba", precision=p) for p in ("float64", "float32")]
    account, seed, end = Account(), 1, time.monotonic() + SECONDS / 4
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        while True:
            for number in range(FEW):
                # every fifth has a symmetry, which roundings break
                own = seed if number % 5 else SYMMETRIC + seed
                account.take_any(engines[number % 2], own, number)
            seed += 1
            if time.monotonic() >= end:
                break
    print(account)
    assert account.networks > 0.8 * FEW
    assert len(account.wrong) <= account.errors // ONE_IN, account.wrong[:10]
    # an error of infinity is always right, and says nothing
    assert account.infinite < 0.3 * account.errors
    assert np.median(account.loose) < 60.0


@pytest.mark.parametrize(
    ("seed", "number"),
    [
        (201, 723),  # grows far, in steps that stability sets
        (203, 1766),  # grows further than it began
        (9509000, 139),  # a limited state with a delay, which runs bring to its limit too early
        (203, 3903),
        (203, 2354),  # a gain in time
        (203, 2958),  # a table bends the rates
        (203, 5736),  # f is curved
        (210, 1295),
        (212, 2482),  # both runs that are compared jump over a corner
        (212, 3669),  # a limited state comes to its limit within the last step
        (212, 4701),  # and leaves it where a gain jumps
        (212, 3683),  # a cell alone decays to nothing
        (212, 4748),
        (214, 7036),  # shrinks before it grows
    ],
)
def test_errors_that_were_below_the_true_one(seed, number):
    engine = cnnum.Engine("numba", precision=("float64", "float32")[number % 2])
    account = Account()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        account.take(engine, seed, number)
    assert account.networks == 1
    assert not account.wrong


@pytest.mark.one_in(4)
@pytest.mark.parametrize("number", [70, 32, 110, 198])
def test_errors_of_implicit_steps_that_were_below_the_true_one(number):
    """Two runs that are compared took the same steps where growth sets them."""
    account = Account()
    account.take(cnnum.Engine("numba", precision="float64"), 214, number, method="rodas3")
    assert account.networks == 1
    assert not account.wrong


@pytest.mark.parametrize("name", ["numba", "opencl", "reference"])
@pytest.mark.parametrize(
    ("number", "method", "at"), [(1220, "bogacki-shampine", 0), (1834, "dormand-prince", 3)]
)
def test_saturated_cells_hide_no_growth(name, number, method, at):
    """They have the largest rates, which fall while the error of the others grows."""
    net = network_of(201, number)
    how = {**net.how, "method": method}
    net = replace(net, times=(net.times[at],), how=how)
    engine = cnnum.Engine(name, precision="float64")
    (verdict,) = judged(engine, net, number)
    assert verdict.method == method
    assert verdict.covered


@pytest.mark.parametrize("factor", [0.0, 0.2])
def test_a_smaller_error_would_be_found(factor):
    """Engines that state nothing, or the same small number of every run, fail."""
    engine, account = cnnum.Engine("numba", precision="float64"), Account()

    class Understates:
        name, precision = "numba", "float64"

        def run(self, *arguments, **options):
            found = engine.run(*arguments, **options)
            object.__setattr__(found, "error", factor * 1e-6 * np.ones_like(found.error))
            return found

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for number in range(8):
            account.take(Understates(), 1, number)
    assert account.wrong


def test_the_truth_of_a_cell_is_its_closed_form():
    """One cell, x' = (−x + a x + z)/τ."""
    a, z, tau, start, end = 1.7, 0.3, 0.5, 1e-4, 2.0
    kernel, none = np.full((1, 1, 1, 1), a), np.zeros((1, 1, 1, 1))
    net = Network(
        A=kernel, B=none, z=np.array([z]), tau=np.array([tau]), boundary=0.0, rim=0.0,
        output="linear", gains=(), late=None, bends=(), u=np.zeros((1, 1, 1)),
        x=np.full((1, 1, 1, 1), start), bias=None, held=None, times=(end,),
    )  # fmt: skip
    rate = (a - 1.0) / tau
    want = start * np.exp(rate * end) + z / tau * np.expm1(rate * end) / rate
    assert Truth(net).ends(1e-12).item() == pytest.approx(want, rel=1e-9)


def test_networks_are_of_every_kind():
    nets = [network_of(1, number) for number in range(400)]
    assert {net.output for net in nets} == {
        "standard", "full-range", "linear", "tanh", "sign", "soft", "steep"}  # fmt: skip
    assert all(any(getattr(net, part) for net in nets) for part in ("gains", "late", "bends"))
    assert any(np.abs(net.x).max() < 1e-6 for net in nets)
    assert any(net.held is not None for net in nets)
    assert any(len(net.times) > 5 for net in nets)
    assert {len(net.tau) for net in nets} == {1, 2, 3}


@pytest.mark.parametrize(
    ("seed", "number", "precision"),
    [
        (1, 83, "float64"),  # tanh, by Heun's steps
        (1, 102, "float64"),
        (1, 113, "float32"),  # at several times
        (2, 98, "float64"),  # a delay: steps end at the limit, however long they are
        (OPPOSITE - SYMMETRIC + 1, 41, "float32"),  # mirrored cells have opposite states
        (OPPOSITE - SYMMETRIC + 1, 44, "float64"),
    ],
)
def test_roundings_that_break_a_symmetry_are_in_the_error(seed, number, precision):
    """The start decays, and what tells its mirrored cells apart grows by e^20 to e^60."""
    account = Account()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        account.take_any(cnnum.Engine("numba", precision=precision), SYMMETRIC + seed, number)
    assert account.networks == 1
    assert not account.wrong


def test_the_truth_of_a_symmetric_network_is_that_of_its_halves():
    """Two cells with weights a and b: their sum grows by a + b − 1, and they never differ."""
    kernel = np.array([[0.0, 0.0, 0.0], [-9.5, 10.0, -9.5], [0.0, 0.0, 0.0]])[None, None]
    net = Network(
        A=kernel, B=np.zeros((1, 1, 1, 1)), z=np.zeros(1), tau=np.ones(1), boundary=0.0, rim=0.0,
        output="linear", gains=(), late=None, bends=(), u=np.zeros((1, 1, 2)),
        x=np.full((1, 1, 1, 2), 0.3), bias=None, held=None, times=(5.0,),
    )  # fmt: skip
    assert Truth(net).ends(1e-12).ravel() == pytest.approx(0.3 * np.exp(-2.5), rel=1e-9)
    # the solver alone: one rounding grows by e^{18.5 · 5}
    assert np.abs(Truth(net, alike=False).ends(1e-12, 1e-15)).max() > 1e20


@pytest.mark.parametrize(
    ("number", "method"),
    [(15, "exponential-euler"), (349, "etd-rk2")],  # grows from little; looked at within a step
)
def test_errors_of_fixed_steps_that_were_below_the_true_one(number, method):
    account = Account()
    engine = cnnum.Engine("numba", precision="float64")
    account.take(engine, 901, number, method=method, estimate=True)
    assert (account.networks, account.infinite, account.wrong) == (1, 0, [])


def test_a_small_start_is_solved_as_well_as_others_on_the_reference():
    """1e-8 grows to 0.66 by e^{2t}; solved to an absolute tolerance it stated 1e-13 for 5e-7."""
    template = cnnum.Template(
        "grows", [[0.0, 0.0, 0.0], [0.5, 2.0, 0.5], [0.0, 0.0, 0.0]], output="linear",
        boundary="zero-flux",
    )  # fmt: skip
    run = cnnum.Engine("reference").run(template, state=np.full((1, 4), 1e-8), duration=9.0)
    true = 1e-8 * np.exp(18.0)
    assert np.abs(run.state - true).max() <= run.error < 1e-7 * true


@pytest.mark.parametrize("method", ["heun", "euler"])
def test_steps_of_one_length_that_are_long_against_a_growth(method):
    """Four steps of two time constants, in each of which the state grows tenfold."""
    account = Account()
    engine = cnnum.Engine("numba", precision="float64")
    account.take(engine, 5401, 219, method=method, estimate=True)
    assert account.networks == 1
    assert not account.infinite
    assert not account.wrong
