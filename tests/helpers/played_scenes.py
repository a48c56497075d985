"""Packaged scenes, played with the truth of each frame, whose events say what the outputs say."""

import numpy as np
import pytest

from cnnum.scenes.pipeline import load_scene

TELLS = {
    "contact": ("contact_row", "contact_column", "load_normal", "N"),
    "release": ("contact_row", "contact_column"),
    "slip": ("slip_x", "slip_y", "slip_strength", "score"),
    "twist": ("twist_row", "twist_column", "twist_strength", "score", "twist_sense"),
    "edge": ("edge_row", "edge_column"),
    "bump": ("bump_row", "bump_column", "bump_normal", "N"),
    "bump_release": ("bump_row", "bump_column"),
    "texture": ("", "", "friction", "score"),
    **dict.fromkeys(["grasp_slip", "grasp_tilt"], ("grasp_x", "grasp_y")),
    **dict.fromkeys(["grasp_twist", "grasp_squeeze"], ("", "", "", None, "grasp_sense")),
    **dict.fromkeys(["outline", "outline_lost"], ("contour_row", "contour_column")),
    "onset": ("on_row", "on_column", "on_strength", "score"),
    "offset": ("off_row", "off_column", "off_strength", "score"),
    "flow": ("flow_x", "flow_y", "flow_speed", "cells/s"),
    "drift": ("motion_x", "motion_y", "motion_strength", "share"),
    **dict.fromkeys(["flow_end", "drift_end"], ()),
    "pressure": ("sa1_row", "sa1_column", "sa1_strength", "score"),
    "motion": ("ra1_row", "ra1_column", "ra1_strength", "score"),
    "vibration": ("pc_row", "pc_column", "pc_strength", "score"),
    "stretch": ("sa2_row", "sa2_column", "sa2_strength", "score"),
    "pressure_end": ("sa1_row", "sa1_column"),
    "motion_end": ("ra1_row", "ra1_column"),
    "vibration_end": ("pc_row", "pc_column"),
    "stretch_end": ("sa2_row", "sa2_column"),
}
"""Outputs of each event's place, or of its direction (x, y), of its strength, the strength's unit,
and the output of its sense."""


def tell_the_same(moments):
    """Hold all outputs to be numbers, and all events to be what the outputs of their frame say."""
    for moment in moments:
        for name, output in moment.outputs.items():
            assert np.isfinite(output).all(), name
        for event in moment.events:
            first, second, strength, unit, sense = (
                *TELLS[event.kind], *("", "", "", None, "")[len(TELLS[event.kind]) :]
            )  # fmt: skip
            one, other = (float(moment.outputs[n]) if n else None for n in (first, second))
            where = (one, other) if first.endswith("row") else None
            way = None if where or not first else pytest.approx(np.arctan2(other, one))
            if event.kind == "stretch":
                pull = moment.outputs["stretch_y"], moment.outputs["stretch_x"]
                way = pytest.approx(np.arctan2(*pull))
            if event.motion == "pivot":
                sense = "slip_sense"
                if moment.outputs["slip_centred"]:
                    where = tuple(float(moment.outputs[f"slip_{n}"]) for n in ("row", "column"))
            assert (event.time, event.frame) == (moment.frame.time, moment.number)
            assert (event.where, event.direction, event.unit) == (where, way, unit)
            assert event.strength == (float(moment.outputs[strength]) if strength else None)
            assert event.sense == (moment.outputs[sense] if sense else None)


def played(name, **changes):
    """Return a scene, its moments and the truth of each."""
    scene = load_scene(name, changes=changes)
    moments = [moment for moment in scene.results() if moment.outputs]
    tell_the_same(moments)
    return scene, moments, [moment.frame.truth for moment in moments]


def place_of(scene, truth):
    """Return row and column of the middle of a body."""
    middle = (np.array(scene.driver.shape) - 1) / 2
    return middle + np.array([truth["y"], truth["x"]]) / scene.driver.pitch


def kinds_of(moments):
    return [event.kind for moment in moments for event in moment.events]


def onset(moments, truths, flag):
    """Return the time at which the truth has a flag first, s."""
    return next(m.frame.time for m, t in zip(moments, truths, strict=True) if t[flag])


BODIES = {
    "punch": {"array.start": (-0.9e-3, -1.4e-3)},
    "bar": {"array.width": 2.6e-3, "array.length": 7.5e-3, "array.angle": 0.4},
    "ring": {"array.width": 8e-3},
    "two bodies": {"array.width": 4e-3, "array.length": 5.8e-3, "array.angle": 0.6},
}
