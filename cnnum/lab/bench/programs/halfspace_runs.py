"""The half-space programs measured: error against time, against ν, against the cover."""

from collections.abc import Iterator, Mapping
from functools import partial

import numpy as np

from cnnum.arrays import Floats
from cnnum.engine import Engine
from cnnum.graph.nodes import RunSpec
from cnnum.integrators.schemes import CHEBYSHEV
from cnnum.lab.bench.timing import timed
from cnnum.programs import program
from cnnum.programs.fields import Field
from cnnum.programs.library import get_program
from cnnum.programs.machine import FrameFields
from cnnum.programs.transients import apply, transient
from cnnum.tactile import halfspace
from cnnum.templates.tactile.cover_model.elastic_lattice import ElasticLattice, matched
from cnnum.templating.checks.tactile.halfspace import cover_stress

Row = dict[str, object]

PITCH, MODULUS, TAXELS = 1.5e-3, 0.87e6, 8
STRESS = ("stress_xz", "stress_yz", "stress_zz")
DEPTH, SIDE = 2.0, 8


def both_ways(engine: Engine) -> Iterator[Row]:
    """Yield error against the transform, and time of one frame of 8×8×3, of waves and layers."""
    load = np.random.default_rng(1).normal(size=(TAXELS, TAXELS, 3))
    wanted = cover_stress(load, 1.0e-3 / PITCH)
    ladder: list[tuple[str, str, Mapping[str, object]]] = [
        ("waves", "halfspace_stress", {"tolerance": 10.0**-n}) for n in range(2, 8)
    ]
    for order in (2, 4):
        for layers in (1, 2, 4, 8):
            own: dict[str, object] = {"layers": layers, "order": order}
            name = f"layers, order {order}"
            ladder.append((f"{name}, in one product", "halfspace_layers", own))
            steps = {"method": "runge-kutta-chebyshev"}
            ladder.append((f"{name}, relaxed", "halfspace_layers", {**own, **steps}))
    for way, name, options in ladder:
        plan = engine.compile(get_program(name).bind(**options), load.shape[:2], STRESS)
        got = plan(load)
        error = max(float(np.abs(got[n] - wanted[..., k]).max()) for k, n in enumerate(STRESS))
        taken = timed(partial(plan, load), budget=0.5)
        yield {
            "way": way,
            **options,
            "error": error / float(np.abs(load).max()),
            "seconds": taken.median,
            "spread": taken.spread,
        }


def love_errors(engine: Engine) -> Iterator[Row]:
    """Yield the error of the waves under a Love patch of 2×2 taxels, by cells a taxel."""
    thickness = 2 * PITCH
    for axis, load_name in enumerate(("q_x", "q_y", "p")):
        for cells in (1, 2, 4, 8):
            n, cell = TAXELS * cells, PITCH / cells
            place = (np.arange(n, dtype=np.float64) + 0.5) * cell - TAXELS * PITCH / 2
            frame = np.zeros((n, n, 3))
            inside = np.abs(place) < PITCH
            frame[..., axis] = inside[:, None] & inside[None, :]
            bound = get_program("halfspace_stress").bind(
                thickness=thickness, pitch=PITCH, cells=cells
            )
            got = engine.compile(bound, (n, n), STRESS)(frame)
            exact = mirrored_patch(np.asarray(place), thickness, axis)
            yield {
                "load": load_name,
                "cells": cells,
                "error": max(
                    float(np.abs(got[s] - got[s].mean() - exact[..., k]).max())
                    for k, s in enumerate(STRESS)
                )
                / float(np.abs(exact).max()),
            }


def mirrored_patch(
    place: Floats, depth: float, axis: int, *, modulus: float | None = None
) -> Floats:
    """Return Love's and Cerruti's stress of a patch and its mirrored images, without the mean.

    Parameters
    ----------
    place : (n,) float, m
        Along both axes, from the middle of the patch of 2×2 taxels.
    depth : float, m
    axis : int
        Of the unit traction: x, y, z.
    modulus : float, optional, Pa
        Young's modulus, for the strain in place of the stress.

    Returns
    -------
    (n, n, 3) float
    """
    total = np.zeros((place.size, place.size, 3))
    load, size = np.eye(3)[axis], (2 * PITCH, 2 * PITCH)
    for m in range(-6, 7):
        for n in range(-6, 7):
            x, y = (place - TAXELS * PITCH * k for k in (m, n))
            if modulus is None:
                field = halfspace.rectangle_stress(x[None, :], y[:, None], depth, load, size=size)
            else:
                field = halfspace.rectangle_strain(
                    x[None, :], y[:, None], depth, load, size=size, youngs_modulus=modulus
                )
            total += field[..., 2, :]
    return np.asarray(total - total.mean((0, 1)), dtype=np.float64)


def equilibrium(cells: int, poisson: float) -> Row:
    """Return how the block of (4.8) relaxes, and how far from (4.9), with loads as they are.

    `matched_error` is that of loads that are matched to the lattice, as the program's are.

    In float64: a relaxation of ten thousands of time constants leaves little to single precision.
    """
    n, engine = SIDE * cells, Engine(precision="float64")
    load = np.zeros((n, n, 3))
    load[cells : 2 * cells, cells : 2 * cells, 2] = 1.0
    load[5 * cells : 6 * cells, 5 * cells : 6 * cells, 2] = -1.0
    lattice = ElasticLattice(6 * cells, 1.0, poisson)

    @program
    def block(frame: FrameFields) -> Mapping[str, Field]:
        spec = RunSpec(method=CHEBYSHEV, rtol=1e-8, atol=1e-8, settle_limit=1e7)
        loads = [frame.channel(c) for c in ("shear_x", "shear_y", "normal")]
        nearer = matched(DEPTH * cells, 1.0)
        run = transient(lattice.template(), input=loads, spec=spec)
        well = transient(
            lattice.template(), input=[apply(nearer, input=load) for load in loads], spec=spec
        )
        level = list(lattice.forces()).index(("u_z", int(DEPTH) * cells))
        down = run.states[level]
        return {"down": down, "time": run.time, "steps": run.steps, "well": well.states[level]}

    plan = engine.compile(block, (n, n), ["down", "time", "steps"])
    got = plan(load) | engine.compile(block, (n, n), ["well"])(load)
    exact = opposite_pushes((np.arange(n) + 0.5) / cells, poisson)
    return {
        "cells": cells,
        "poisson": poisson,
        "error": float(np.abs(got["down"] / cells - exact).max() / np.abs(exact).max()),
        "matched_error": float(np.abs(got["well"] / cells - exact).max() / np.abs(exact).max()),
        "time_constants": float(got["time"]),
        "steps": int(got["steps"]),
        "seconds": timed(partial(plan, load), budget=0.5).median,
    }


def opposite_pushes(place: Floats, poisson: float) -> Floats:
    """Return u_z of (4.9), integrated over two unit squares pushed and pulled, and their images.

    A window that ends gently sums the images, which cancel by turns.
    """
    total = np.zeros((place.size, place.size))
    for m in range(-6, 7):
        for n in range(-6, 7):
            for sign, at in ((1.0, 1.5), (-1.0, 5.5)):
                x, y = at + m * SIDE, at + n * SIDE
                window = np.exp(-((np.hypot(x - SIDE / 2, y - SIDE / 2) / (3.0 * SIDE)) ** 4))
                total += sign * window * halfspace.rectangle_displacement(
                    place[None, :] - x, place[:, None] - y, DEPTH, (0.0, 0.0, 1.0),
                    size=(1.0, 1.0), youngs_modulus=2 * (1 + poisson), poisson=poisson,
                )[..., 2]  # fmt: skip
    return total


def inverse(engine: Engine, pitch: float, thickness: float) -> Row:
    """Return resolution and noise gain of least squares on 8×8 taxels."""
    noise, likely, middle = 1e-4, 3e3, TAXELS // 2
    cover = halfspace.SurfaceToDepth((TAXELS, TAXELS), pitch, thickness, youngs_modulus=MODULUS)
    unit = np.zeros((TAXELS, TAXELS, 3))
    unit[middle, middle, 2] = likely
    bound = get_program("surface_load").bind(
        pitch=pitch, thickness=thickness, noise=noise, likely=likely, drag=1.0, rounds=0
    )
    plan = engine.compile(bound, (TAXELS, TAXELS), ["load_normal"])
    kept = float(plan(cover(unit))["load_normal"][middle, middle]) / likely
    quiet = np.random.default_rng(2).normal(0.0, noise, (200, TAXELS, TAXELS, 3))
    gain = float(plan(quiet)["load_normal"][:, middle, middle].std()) / noise
    return {
        "pitch": pitch,
        "thickness": thickness,
        "kept": kept,
        "width": pitch / max(kept, 1e-3) ** 0.5,
        "noise_gain": gain,
        "noise": gain * noise,
    }
