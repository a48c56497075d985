"""Slip of held objects: against plain NumPy on invented counts, and on real recordings."""

import os
from pathlib import Path

import numpy as np
import pytest

from cnnum.drivers.uskin_csv import UskinCsvOptions
from cnnum.errors import ProgramError
from cnnum.templates.tactile.grasp_slip import grasp_slip

RECORDINGS = Path(os.environ.get("CNNUM_RECORDINGS", "")) / "uskin_grasp"
TRIALS = {
    "02-21-14-10-49": (),
    "02-21-17-22-56": (),
    "02-22-11-23-11": (75, 135),
    "02-22-15-15-00": (73,),
}
"""Rows of the labelled onsets."""


def score(pads, rate, window=0.2):
    """The score of a recording (frames, pads, rows, columns, 3), pad by pad and frame by frame."""
    mean = pads[..., :2].mean(axis=(2, 3))
    change = np.diff(pads, axis=0, prepend=pads[:1])
    loose = change - change.mean(axis=(2, 3), keepdims=True)
    now = np.sqrt((loose**2).sum(axis=-1).mean(axis=(2, 3)))
    slow, rest, noise, activity = mean[0].copy(), mean[0].copy(), 0 * now[0], 0 * now[0]
    scores, pulls = [0.0], [0.0]
    for k in range(1, len(pads)):
        activity = activity + max(1 / k, 2 / (window * rate)) * (now[k] - activity)
        drift = np.linalg.norm(mean[k] - slow, axis=-1)
        slow = slow + max(1 / k, 1 / (window * rate)) * (mean[k] - slow)
        still = (np.maximum.reduce([activity, now[k], drift]) < 2 * noise).all()
        if k <= 0.5 * rate or still:
            step = max(1 / k, 1 / (2.0 * rate))
            noise = noise + step * (now[k] - noise)
            rest = rest + step * (mean[k] - rest)
        pull = np.linalg.norm(mean[k] - rest, axis=-1)
        ready = k > 0.5 * rate
        scores.append(np.sqrt(pull.max() * activity.max()) / noise.mean() if ready else 0.0)
        pulls.append(pull.mean())
    return np.array(scores), np.array(pulls)


def invented(rng, pads, shape=(4, 4), frames=150):
    """Counts of a held object that is pulled twice, rearranging as it goes, and let go between."""
    pull = np.zeros(frames)
    pull[45:65], pull[65:80] = np.linspace(0, 150, 20), np.linspace(150, 5, 15)
    pull[95:115], pull[115:] = np.linspace(5, 150, 20), 150
    loose = np.abs(np.gradient(pull))[:, None, None, None, None]
    counts = 16000 + rng.normal(0, 1.5, (frames, pads, *shape, 3))
    counts += np.cumsum(loose * rng.normal(0, 1.0, counts.shape), axis=0)
    counts[..., 0] += pull[:, None, None, None]
    return np.round(counts)


def side_by_side(pads):
    return np.concatenate(list(np.moveaxis(pads, 1, 0)), axis=2)


def onsets(flag):
    return (np.flatnonzero(np.diff(np.concatenate([[0], flag])) > 0)).tolist()


@pytest.mark.parametrize("pads", [1, 2])
@pytest.mark.parametrize("shape", [(4, 4), (8, 8), (16, 16)])
def test_score_is_what_numpy_says(engine, run, pads, shape):
    counts = invented(np.random.default_rng(7), pads, shape)
    got = run(engine, grasp_slip.bind(pads=pads, rate=60.0), side_by_side(counts))
    expected, _ = score(counts, 60.0)
    # float32 means of numbers of 16000: 1e-3 counts, against noise floors of 1
    np.testing.assert_allclose(got["slip_strength"], expected, rtol=5e-3, atol=5e-3)
    assert len(onsets(got["gross_slip"])) == 2  # one report a pull
    assert got["slip_x"][110] > 0.95


def test_two_trials_in_a_batch(fast, run):
    one, two = (side_by_side(invented(np.random.default_rng(k), 2)) for k in (1, 2))
    both = run(fast, grasp_slip.bind(pads=2), np.stack([one, two], axis=1))
    alone = run(fast, grasp_slip.bind(pads=2), two)
    np.testing.assert_allclose(both["slip_strength"][:, 1], alone["slip_strength"], rtol=1e-5)


def test_a_pull_alone_or_noise_alone_is_no_slip(fast, run):
    rng = np.random.default_rng(3)
    counts = 16000 + rng.normal(0, 1.5, (150, 4, 4, 3))
    pulled = counts.copy()
    pulled[45:, ..., 0] += np.minimum(np.arange(105) * 0.3, 10)[:, None, None]
    shaken = counts.copy()
    shaken[45:] += rng.normal(0, 1.5, shaken[45:].shape)
    for frames in (counts, pulled, shaken):
        assert not run(fast, grasp_slip, np.round(frames), ["gross_slip"])["gross_slip"].any()


def test_gain_and_offset_do_not_matter(fast, run):
    counts = side_by_side(invented(np.random.default_rng(5), 2))
    one = run(fast, grasp_slip.bind(pads=2), counts)["slip_strength"]
    other = run(fast, grasp_slip.bind(pads=2), 2.0 * (counts - 16000))["slip_strength"]
    np.testing.assert_allclose(one, other, rtol=5e-3, atol=5e-3)


def test_columns_must_suit_the_pads():
    with pytest.raises(ProgramError, match="pads"):
        grasp_slip.bind(pads=3).trace((4, 8))


def auc(scores, labels):
    high, low = scores[labels], scores[~labels]
    above = (high[:, None] > low).mean() + 0.5 * (high[:, None] == low).mean()
    return float(above)


@pytest.mark.skipif(not RECORDINGS.is_dir(), reason="CNNUM_RECORDINGS names no recordings")
@pytest.mark.parametrize("repeats", [True, False], ids=["all rows", "new rows"])
def test_real_trials(fast, repeats):
    """One setting for all: labelled onsets within 6 rows, nothing in the trials without slip."""
    plan = fast.compile(grasp_slip.bind(pads=2, rate=59.8), (4, 8))
    scores, labels = [], []
    for trial, wanted in TRIALS.items():
        with UskinCsvOptions(path=RECORDINGS / trial).open() as driver:
            frames = list(driver.frames())
        stream, outputs = plan.stream(), []
        for frame in frames:
            if repeats or not frame.repeated:
                outputs.append(stream.push(frame.values))
            else:
                outputs.append(outputs[-1])
        kept = np.array([not frame.truth["fail"] for frame in frames])
        flag = np.array([float(o["gross_slip"]) for o in outputs])
        found = [row for row in onsets(flag) if kept[row]]
        assert all(min(abs(row - f) for f in found) <= 6 for row in wanted), (trial, found)
        assert wanted or not found, (trial, found)
        scores.append(np.array([float(o["slip_strength"]) for o in outputs])[kept])
        labels.append(np.array([frame.truth["slip"] > 0 for frame in frames])[kept])
    assert auc(np.concatenate(scores), np.concatenate(labels)) >= 0.98
