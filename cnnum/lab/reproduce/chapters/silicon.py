"""Chapter 3: the bare taxel, from stress in silicon to volts (Table 3.I, 3.II, Fig. 3.22)."""

from functools import partial
from math import sqrt

import numpy as np

from cnnum.arrays import Floats
from cnnum.lab.reproduce.faults import scaled
from cnnum.lab.reproduce.figure import Curve, Figure, Panel
from cnnum.lab.reproduce.record import Chapter, Item
from cnnum.tactile.halfspace import circle_axis_stress
from cnnum.tactile.taxel import Bridge, Coupling, Piezoresistor, Readout, Taxel, von_mises

TABLE_LOAD = 10e-3
"""N, the load of Table 3.I."""

TABLE = {
    "Fz": ("normal", -203.5e6, -38.2e6, -0.114),
    "Fx": ("shear along x", 290e6, 55.6e6, 0.162),
    "Fxy": ("shear at 45°", 205e6, 39.3e6, 0.114),
}
"""Table 3.I: load, σ_l and σ_t in Pa, ΔR/R."""

PLATE = 100e-6
"""Side of the suspended plate, m (Fig. 3.8)."""

NEEDLE_TILT = np.radians(4.0)


def resistance(longitudinal: float, transversal: float) -> float:
    """Return ΔR/R of a piezoresistor, (3.7)."""
    return float(Piezoresistor().resistance_change(longitudinal, transversal))


def turned_tensor_gap() -> float:
    """Return how far π_l and π_t are from (3.4), the tensor of silicon turned to the bridge.

    The tensor has π11 on iiii, π12 on iijj and π44/2 on ijij along the crystal's axes. The bridge
    is along (110), its transversal direction along (1̄10).
    """
    silicon = Piezoresistor()
    kind = np.eye(3)
    tensor = np.zeros((3, 3, 3, 3))
    for i, j in np.ndindex(3, 3):
        if i == j:
            tensor[i, i, i, i] = silicon.pi_11
        else:
            tensor[i, i, j, j] = silicon.pi_12
            tensor[i, j, i, j] = tensor[i, j, j, i] = 0.5 * silicon.pi_44
    along, across = (kind[0] + kind[1]) / sqrt(2.0), (kind[1] - kind[0]) / sqrt(2.0)
    current = np.einsum("ijkl,i,j->kl", tensor, along, along)
    theirs = [float(n @ current @ n) for n in (along, across)]
    gaps = np.array([silicon.longitudinal, silicon.transversal]) - theirs
    return float(np.abs(gaps).max() / silicon.pi_44)


def slanted() -> float:
    """Return (ΔV_right − ΔV_left)/(ΔV_top + ΔV_bottom) under a load at 45° towards x."""
    left, right, top, bottom = Bridge().voltages(1e-3 * np.array([1.0, 0.0, 1.0])).tolist()
    return float((right - left) / (top + bottom))


def diagonal_shear() -> float:
    """Return the largest ΔR/R of the four bridges under 10 mN of shear at 45°."""
    force = TABLE_LOAD * np.array([1.0, 1.0, 0.0]) / sqrt(2.0)
    return float(Bridge().resistance_change(force).max())


def sensitivity() -> float:
    """Return the normal sensitivity of a half bridge, mV per mN of load and V of supply."""
    bridge = Bridge()
    volts = bridge.voltages([0.0, 0.0, TABLE_LOAD])[0]
    return float(abs(volts) / TABLE_LOAD / bridge.supply)  # V/N/V is mV/mN/V


def response(tilt: float = 0.0) -> tuple[Floats, Floats]:
    """Return 41 loads up to 2 mN, N, and the half-bridge voltages of a full bridge law."""
    loads = np.linspace(0.0, 2e-3, 41)
    direction = np.array([np.sin(tilt), 0.4 * np.sin(tilt), np.cos(tilt)])
    return loads, Bridge(linear=False).voltages(loads[:, np.newaxis] * direction)


def off_line(loads: Floats, volts: Floats) -> float:
    """Return the largest deviation from the best line, share of the range."""
    line = np.polynomial.Polynomial.fit(loads, volts, 1)
    return float(np.abs(volts - line(loads)).max() / np.ptp(volts))


def bend() -> float:
    """Return the largest deviation from the best line over 0–2 mN, share of the range."""
    loads, volts = response()
    return off_line(loads, volts[:, 0])


def table_change(load: float, case: str = "Fz") -> float:
    """Return ΔR/R under a load, N, from the stresses of a row of Table 3.I by (3.7)."""
    _, along, across, _ = TABLE[case]
    return 0.5 * 138.1e-11 * (along - across) * load / TABLE_LOAD


def half_bridge_bend() -> float:
    """Return the same of the circuit of Fig. 3.13: R(1 + δ) in series with R, over 0–2 mN."""
    loads = np.linspace(0.0, 2e-3, 41)
    change = np.array([table_change(load) for load in loads.tolist()])
    return off_line(loads, (1.0 + change) / (2.0 + change))


def covered_output(gain: float, reduction: float) -> float:
    """Return the amplified bridge voltage of 30 mN above the centre of a covered taxel, mV."""
    taxel = Taxel(
        Coupling.nominal(reduction=reduction), readout=Readout(gain=gain, limit=10.0, noise=0.0)
    )
    depth_strain = np.array([0.0, 0.0, -30e-3 / (2.0 * np.pi * 0.87e6 * 200e-6**2 / 3.0)])
    return float(1e3 * np.abs(taxel.read(depth_strain.reshape(1, 1, 3)).volts).max())


def full_scale_load() -> float:
    """Return the bare load, mN, that gives 1500 mV at a gain of 55."""
    return 1e3 * 1.5 / (55.0 * Bridge().supply * sensitivity())


def cover_loss(depth: float) -> float:
    """Return how many times less load reaches the plate under a cover of that thickness.

    The load is a point load on a half-space, and the plate a disc of its area at that depth. The
    share is, by reciprocity, the pressure below the middle of a loaded disc times its area.
    """
    radius = PLATE / sqrt(np.pi)
    share = -circle_axis_stress(depth, [0.0, 0.0, 1.0], radius=radius)[2, 2]
    return float(1.0 / share)


def equivalent_stress() -> float:
    """Return the von Mises stress of the stresses at the resistor under 10 mN normal load, MPa."""
    return float(von_mises([-203.5, -38.2, 0.0]))


def figure_3_22() -> Figure:
    """Return the response of four bridges under a needle that stands a little askew."""
    loads, upright = response()
    tilted = response(NEEDLE_TILT)[1]
    names = ("left", "right", "top", "bottom")
    slanted = [Curve(1e3 * loads, -1e3 * tilted[:, n], name) for n, name in enumerate(names)]
    return Figure(
        "fig-3.22",
        "Fig. 3.22",
        "Response of four bridges to a normal load",
        "Half-bridge voltages (sign turned) without amplifier, with the half bridge's own slight "
        f"bend. The printed slopes differ because the needle stood off the centre; here it "
        f"leans by {np.degrees(NEEDLE_TILT):.0f}°, so that some of the load is shear.",
        (
            Panel(
                "Needle upright: all four alike",
                "load F (mN)",
                "−ΔV (mV)",
                [Curve(1e3 * loads, -1e3 * upright[:, 0], "each bridge", colour=0)],
            ),
            Panel("Needle leaning", "load F (mN)", "−ΔV (mV)", slanted),
        ),
    )


def _table_rows() -> tuple[Item, ...]:
    return tuple(
        Item(
            f"table-3.I-{case}",
            f"ΔR/R under 10 mN, {load}",
            f"Table 3.I, row {case}; (3.7)",
            published,
            partial(resistance, along, across),
            5e-4,
            "the table prints three decimals",
            faults=(scaled(Piezoresistor.resistance_change, 1.01),),
        )
        for case, (load, along, across, published) in TABLE.items()
    )


CHAPTER = Chapter(
    "Chapter 3 — the bare taxel",
    (
        Item(
            "eq-3.4",
            "π_l and π_t against the whole tensor of silicon, turned to the bridge",
            "(3.4), (3.6)",
            0.0,
            turned_tensor_gap,
            1e-14,
            "rounding",
            unit="π44",
            faults=(
                scaled(Piezoresistor.longitudinal, 1.0001),
                scaled(Piezoresistor.transversal, 1.0001),
            ),
        ),
        Item(
            "fig-6.2",
            "right less left over top and bottom, of a load that leans by 45° towards x",
            "Fig. 6.2, slanted load; Table 3.I",
            -table_change(1.0, "Fx") / table_change(1.0),
            slanted,
            1e-9,
            "(3.7) of the stresses of Table 3.I: rounding. The sensor of Fig. 6.2 has a rod, and "
            "its digits are not published",
            faults=(
                scaled(Bridge.matrix, -1.0, entry=(1, 0)),
                scaled(Bridge.matrix, 1.001, entry=(1, 0)),
            ),
        ),
        *_table_rows(),
        Item(
            "table-3.I-diagonal",
            "ΔR/R of the whole taxel under 10 mN at 45°",
            "Table 3.I, row Fxy; (3.8)",
            table_change(TABLE_LOAD, "Fx") / sqrt(2.0),
            diagonal_shear,
            1e-9,
            "its row Fx by (3.7), times cos 45°: rounding. That two shears superpose is the "
            "model's own assumption; the table has 0.114",
            faults=(scaled(Bridge.resistance_change, 1.01),),
        ),
        Item(
            "table-3.I-von-mises",
            "von Mises stress from σ_l and σ_t at the resistor",
            "Table 3.I, row Fz; (3.2)",
            203.8,
            equivalent_stress,
            0.0,
            "the table's largest stress stands elsewhere in the bridge than its σ_l and σ_t",
            unit="MPa",
            kind="comparison",
        ),
        Item(
            "2.9-mV/mN/V",
            "sensitivity to normal load; (3.11) is printed without the half bridge's factor ¼",
            "section 3.4.3: 2.9; (3.11)",
            0.25 * abs(table_change(1.0)),
            sensitivity,
            1e-9,
            "a quarter of ΔR/R of Table 3.I by (3.7): rounding; the text has it in two digits",
            unit="mV/mN/V",
            figure="fig-3.22",
            printed=lambda: 4.0 * sensitivity(),
            faults=(scaled(Bridge.voltages, 0.99),),
        ),
        Item(
            "2.9-measured",
            "sensitivity as measured on bare sensors",
            "section 3.4.3, Table 3.II",
            (4.0, 6.0),
            sensitivity,
            0.0,
            "real bridges are thinner than drawn, and needles were placed to ±30 µm",
            unit="mV/mN/V",
            rule="within",
            kind="comparison",
            figure="fig-3.22",
        ),
        Item(
            "fig-3.22",
            "bend of the response from a straight line, 0–2 mN: that of the half bridge's circuit",
            "Fig. 3.22, “linear response”; Fig. 3.13",
            half_bridge_bend(),
            bend,
            1e-9,
            "both are formulas: rounding. The bend is 0.2 % of the range, too little to be seen in "
            "the figure",
            unit="of the range",
            figure="fig-3.22",
            faults=(scaled(Bridge.resistance_change, 1.01),),
        ),
        Item(
            "table-3.II-output",
            "output of 30 mN under a cover that divides by 30, gain 60",
            "Table 3.II: 1–1500 mV; section 4.3.2",
            1e3 * 60.0 * 0.25 * 5.0 * abs(table_change(30e-3 / 30.0)),
            partial(covered_output, 60.0, 30.0),
            0.5 * 1e3 * 2.0 * 10.0 / 2.0**12,
            "gain · V/4 · ΔR/R of Table 3.I; half a step of the 12-bit converter over ±10 V",
            unit="mV",
            faults=(scaled(Coupling.force, 1.01), scaled(Bridge.voltages, 1.01)),
        ),
        Item(
            "table-3.II-load",
            "bare load that fills the output range",
            "Table 3.II: 0–3 mN",
            3.0,
            full_scale_load,
            0.0,
            "the text advises 0–2 mN; above, 1500 mV is passed at any gain of 50–60",
            unit="mN",
            kind="comparison",
        ),
        *(
            Item(
                f"table-3.II-cover-{depth}",
                f"loss of sensitivity under {depth} µm of rubber",
                "Table 3.II; section 4.3.2",
                published,
                partial(cover_loss, 1e-6 * depth),
                0.0,
                "share of the load on the plate alone; the bridges next to it carry some more",
                rule="within",
                kind="comparison",
            )
            for depth, published in ((220, (5.0, 30.0)), (500, (25.0, 35.0)))
        ),
    ),
    {"fig-3.22": figure_3_22},
)
