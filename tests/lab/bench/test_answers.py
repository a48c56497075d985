"""The race to the answer compares both pictures, and says where they differ."""

import importlib.util

import numpy as np
import pytest

import cnnum
from cnnum.lab.bench import answers


@pytest.mark.parametrize("template", sorted({case.template for case in answers.CASES}))
def test_both_sides_give_one_picture(template):
    like = next(case for case in answers.CASES if case.template == template)
    peers = like.peers
    shape = (3, 20, 17) if template in ("EDGE", "HOLE") else (70, 63)
    case = answers.Case(template, shape, peers, like.gray)
    for peer, prepare in peers.items():
        module = {"OpenCV": "cv2", "scikit-image": "skimage"}.get(peer.split()[0])
        if module is not None and importlib.util.find_spec(module) is None:
            continue
        row = answers.measure(cnnum.Engine("numba"), case, peer, prepare, 0.01)
        assert row.wrong == 0 or (peer in like.others and row.wrong < 0.2 * np.prod(shape))
        assert row.ratio == pytest.approx(row.peer_seconds / row.seconds)
        assert (row.memory_share is not None) is (row.method == "decision")
        assert row.memory_share is None or 0.0 < row.memory_share < np.inf
        black = answers.pictures(case)[0]
        assert 0.3 < black.mean() < 0.7


def test_a_peer_that_gives_another_picture_is_seen():
    case = answers.Case("HOLE", (12, 12), {})
    row = answers.measure(cnnum.Engine("numba"), case, "none", lambda b, _: lambda: 0 * b, 0.01)
    black, _ = answers.pictures(case)
    assert row.wrong >= black.sum() > 0
    assert np.isfinite(row.ratio)
