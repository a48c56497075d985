"""The four receptor channels of the skin (Vásárhelyi's Table 2.I), and the spikes that they send.

    channel        signal        receptive field          in time, by its template
    SA-I           push          small, Ø 2 mm            slow_receptor, to 15 Hz
    RA-I           push          small, Ø 2.5 mm          rapid_receptor, 20 to 50 Hz
    PC (RA-II)     push          large, Ø 7.9 mm          vibration_receptor, 60 to 400 Hz
    SA-II          shear         large, Ø 5.6 mm          slow_receptor, to 15 Hz

A receptive field is a bell shape made by diffusion. In time, each cell has a few layers with time
constants in seconds. The signal is interpolated linearly between two frames. A piecewise linear
signal therefore gives the same response at any rate, and the error for any other is at most
`gain · dt² / 8 · max |u″|`. A leaky cell that integrates the output of its channel, fires at a
threshold and is then reset produces the spikes.

References
----------
Vásárhelyi (2007), 2.2; Johansson & Vallbo, Brain Res. 184 (1980) 353: fields of SA-II and PC are 5
and 10 times as large in area. Johansson & Birznieks, Nat. Neurosci. 7 (2004) 170: first spikes.
"""

from collections.abc import Mapping
from math import ceil
from typing import Literal, get_args

from cnnum.errors import name_error
from cnnum.programs import program
from cnnum.programs.fields import Field, exp, length, log, maximum, minimum, square, where
from cnnum.programs.loops import loop
from cnnum.programs.machine import FrameFields
from cnnum.programs.parameters import refuse_outside
from cnnum.programs.reports import report
from cnnum.templates.tactile.shared.loads import PUSH
from cnnum.templates.tactile.shared.rest import Clock, over_field, with_corners

Between = Literal["line", "hold"]
"""The signal between two frames: linear, or constant at the later value."""

ONE_WAY = 0.5
"""Smallest share of all stretch in one direction: a push alone draws in skin from all sides."""

APART = 0.1
"""Time without spikes, in s, after which the next spike is the first of a new touch."""


@program
def receptors(
    frame: FrameFields,
    *,
    push: float = PUSH,
    rest: float = 0.4,
    between: Between = "line",
    sa1_field: float = 4.0 / 3.0,
    ra1_field: float = 5.0 / 3.0,
    pc_field: float = 5.3,
    sa2_field: float = 3.7,
    sa_to: float = 15.0,
    ra1_from: float = 20.0,
    ra1_to: float = 50.0,
    pc_from: float = 60.0,
    pc_to: float = 400.0,
    level: float = 10.0,
    hold_time: float = 0.05,
    threshold: float = 0.0,
    membrane: float = 0.01,
    refractory: float = 0.001,
) -> Mapping[str, Field]:
    """Compute the channels SA-I, RA-I, PC and SA-II, their events and their spikes.

    Parameters
    ----------
    frame : FrameFields
        Strain, stress, signals or raw counts. SA-I, RA-I and PC read `normal`, SA-II the shear.
    push : float
        −1 for strain and stress, which count tension as positive; +1 if readings rise under a push.
    rest : float, s
        Time without motion at the start, from which rest and noise are learned.
    between : "line" or "hold"
        Interpolation of the signal between two frames. With "hold", as behind a converter, RA-I and
        PC depend on the frame rate.
    sa1_field, ra1_field, pc_field, sa2_field : float
        Width of a receptive field at half of its height, in pitches (or "2 mm").
    sa_to, ra1_from, ra1_to, pc_from, pc_to : float, Hz
        Corner frequencies: the low-pass of SA-I and SA-II, the high-pass and low-pass of RA-I, and
        those of PC, whose high-pass is applied twice.
    level, hold_time : float, none, s
        An event begins when the largest output of a channel exceeds `level` times its noise at
        rest, and ends when the output has been below half of that for `hold_time`.
    threshold : float
        Output of a channel above which its cells send spikes, in the unit of the channel; 0 for
        `level` times the noise, which depends on the frame rate.
    membrane, refractory : float, s
        Time constant of the leaky cell, and the time for which it is silent after a spike.

    Returns
    -------
    mapping
        `sa1`, `ra1`, `pc` (maps in the unit of `normal`; RA-I and PC are positive where a push
        grows), `sa2`, `sa2_x`, `sa2_y` (maps in the unit of shear: magnitude and components),
        `stretch_x`, `stretch_y` (sums of the components of SA-II). For each channel, as for
        `sa1`: `sa1_active` (flag), `sa1_strength` (largest output over its noise; for SA-II the
        sum, if half of all stretch has one direction), `sa1_row`, `sa1_column` (centroid of the
        squared output, cells; its last value once the strength no longer exceeds `level`),
        `sa1_spikes` (map: number of spikes since the previous frame, negative where the output is),
        `sa1_spike_time` (map: time of the first of them relative to this frame, s; at most 0),
        `sa1_spike_gap` (map: interval between them, s; 0 if there is only one), `sa1_first` (map:
        delay of the first spike of the cell after the first one of the touch anywhere, s; −1
        before).

    Raises
    ------
    ProgramError
        If a parameter is out of range.
    UnknownNameError
        If `between` is unknown.
    """
    if between not in get_args(Between):
        raise name_error("course between two frames", between, get_args(Between))
    refuse_outside(
        level=(level, 1.0, 1e6), hold_time=(hold_time, 0.0, 1e6),
        threshold=(threshold, 0.0, 1e30), membrane=(membrane, 1e-6, 1e3),
        refractory=(refractory, 1e-4, 1e3),
    )  # fmt: skip
    for name, corner in (("sa1", sa_to), ("ra1", ra1_to), ("pc", pc_to), ("sa2", sa_to)):
        frame.sees(corner, *(f"{name}_{part}" for part in ("active", "spikes", "first")))
    clock = _Channels(frame, rest, held=between == "hold")
    push_map = clock.above_rest("normal", push)
    shear = [clock.above_rest(name, push) for name in ("shear_x", "shear_y")]
    slow = with_corners("slow_receptor", (sa_to,))
    rapid = with_corners("rapid_receptor", (ra1_from, ra1_to))
    vibrating = with_corners("vibration_receptor", (pc_from, pc_from, pc_to))
    x, y = (clock.behind(slow, over_field(component, sa2_field)) for component in shear)
    channels = {
        "sa1": clock.behind(slow, over_field(push_map, sa1_field)),
        "ra1": clock.behind(rapid, over_field(push_map, ra1_field)),
        "pc": clock.behind(vibrating, over_field(push_map, pc_field)),
        "sa2": length([x, y]),
    }
    result = {**channels, "sa2_x": x, "sa2_y": y, "stretch_x": x.sum(), "stretch_y": y.sum()}
    for name, output in channels.items():
        reads = ("shear_x", "shear_y") if name == "sa2" else ("normal",)
        noise = clock.noise(square(output).mean(), reads)
        # a surface that is drawn up sends nothing by a slow channel
        drive = maximum(output, 0.0) if name == "sa1" else output
        peak = abs(drive).max(), noise
        if name == "sa2":
            net = length([result["stretch_x"], result["stretch_y"]])
            pulled = where(net > ONE_WAY * output.sum(), net, 0.0)
            peak = pulled, clock.noise(square(net), reads)
        result |= clock.event(name, drive, *peak, level, hold_time)
        fires = frame.constant(threshold) if threshold > 0.0 else level * noise
        result |= clock.spikes(name, drive, fires, membrane, refractory)
    return result


class _Channels(Clock):
    """Channels of the skin in time: their events and spikes."""

    def event(
        self, name: str, output: Field, peak: Field, noise: Field, level: float, hold_time: float
    ) -> dict[str, Field]:
        """Return whether a channel is active, how strongly, and where."""
        strength = where(self.resting, 0.0, peak / noise)
        above_level = strength > level
        row, column = (
            self.frame.memory(f"last {axis} of {name}", scalar=True).hold(place, above_level)
            for axis, place in zip(
                ("row", "column"), self.frame.centroid(square(output)), strict=True
            )
        )
        return {
            f"{name}_active": report(self.frame, strength, level, hold_time * self.rate),
            f"{name}_strength": strength,
            f"{name}_row": row,
            f"{name}_column": column,
        }

    def spikes(
        self, name: str, output: Field, fires: Field, membrane: float, refractory: float
    ) -> dict[str, Field]:
        """Return the spikes of leaky cells under the mean of an output since the frame before.

        Of a constant current I a cell without charge fires after membrane · ln(I / (I − fires)).
        """
        frame, lasts = self.frame, 1.0 / self.rate
        charge, wait = frame.memory(f"charge of {name}"), frame.memory(f"wait of {name}")
        driven = where(self.resting, 0.0, output)
        mean = 0.5 * (driven + frame.previous(driven))
        sign, current = where(mean < 0.0, -1.0, 1.0), abs(mean)
        strong = current > fires

        def next_spike(
            left: Field, held: Field, count: Field, first: Field
        ) -> tuple[Field, Field, Field, Field]:
            takes = maximum(membrane * log((current - held) / (current - fires)), 0.0)
            fired = strong & (left > 0.0) & (left >= takes)
            fades = exp(-1.0 / membrane * maximum(left, 0.0))
            return (
                where(fired, left - takes - refractory, minimum(left, 0.0)),
                where(fired, 0.0, current + (held - current) * fades),
                count + where(fired, 1.0, 0.0),
                where(fired & (count < 0.5), lasts - left + takes, first),
            )

        def over(left: Field, *_: Field) -> Field:
            return ~(left > 0.0).any()

        none = 0.0 * current
        left, held, count, first = loop(
            next_spike,
            maximum(lasts - wait.value, 0.0),
            sign * charge.value,
            none,
            none,
            limit=ceil(lasts / refractory) + 2,
            until=over,
        ).values
        charge.store(sign * held)
        # what is left below 0 is silence that goes on in the next frame
        wait.store(maximum(wait.value - lasts, 0.0) + maximum(-left, 0.0))
        gap = refractory + membrane * log(current / (current - fires))
        return {
            f"{name}_spikes": where(count > 0.5, sign * count, 0.0),
            f"{name}_spike_time": where(count > 0.5, first - lasts, 0.0),
            f"{name}_spike_gap": where(count > 1.5, gap, 0.0),
            f"{name}_first": self._first(count > 0.5, first),
        }

    def _first(self, spiked: Field, time: Field) -> Field:
        """Return the time of each cell's first spike after the first one of a touch, −1 before."""
        frame, lasts = self.frame, 1.0 / self.rate
        some = spiked.any()
        silent = frame.memory("frames without a spike", scalar=True).count(~some)
        begun = frame.memory("touch has begun", scalar=True, logic=True)
        since, known = frame.memory("since the touch began", scalar=True), frame.memory("first + 1")
        earliest = where(spiked, time, lasts).min()
        start = where(begun.value, since.value, -earliest)
        since.store(start + lasts)
        was = where(begun.value, known.value, 0.0)
        begun.latch(some, silent <= max(1.0, APART * self.rate))
        now = where(was > 0.0, was, where(spiked, 1.0 + start + time, 0.0))
        known.store(now)
        return now - 1.0
