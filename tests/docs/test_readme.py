"""The examples of the README and the docs run as they stand."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import ndimage
from scipy.integrate import solve_ivp

import cnnum
from cnnum.embedded.making import real

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
FOUND = [
    (f"{page.relative_to(ROOT)}-{number}", code, shown)
    for page in PAGES
    for number, (code, shown) in enumerate(
        re.findall(r"```python\n(.*?)```(?:\n```\n(.*?)```)?", page.read_text(), re.DOTALL)
    )
]
BLOCKS = [pytest.param(name, code, shown, id=name) for name, code, shown in FOUND]


def corners_are_four(names, said):
    """Those of the rectangle in the picture; nothing is pressed in a frame of zeros."""
    found = {tuple(cell) for cell in np.argwhere(names["result"].output > 0).tolist()}
    assert found == {(2, 2), (2, 6), (5, 2), (5, 6)}
    assert not names["plan"](np.zeros((8, 8, 3)))["contact"]
    pressed = np.zeros((8, 8, 3))
    pressed[2:5, 2:5, 2] = 1.0
    assert names["plan"](pressed)["contact"]


def edges_are_those_of_the_punch(names, said):
    """A disc of 6 mm on taxels 1.5 mm apart, in the first frame that is clear of the noise."""
    moment = names["moment"]
    assert [event.kind for event in moment.events] == ["edge"]
    truth, rows = moment.frame.truth, np.argwhere(moment.outputs["edges"] > 0)
    middle = 3.5 + np.array([truth["y"], truth["x"]]) / 1.5e-3
    off = np.abs(np.hypot(*(rows - middle).T) - 2.0)
    assert len(rows) >= 6
    assert np.median(off) < 0.5
    assert (off < 1.0).mean() > 0.8
    assert names["record"]["edges"].shape == (100, 8, 8)


def a_product_settles_where_its_equation_does(names, said):
    """Two equal neighbours: x' = −x + 0.5 x + 0.1 x² + u, at rest at 5 (½ − √(¼ − 0.4 u))."""
    got = cnnum.Engine("reference").run(names["template"], input=[[0.1, 0.1]], duration=60.0)
    assert got.state == pytest.approx(5.0 * (0.5 - np.sqrt(0.25 - 0.04)), abs=1e-6)


def outlined(pictures):
    """Return where a black pixel has a white one among its eight neighbours."""
    padded = np.pad(pictures > 0, [(0, 0), (1, 1), (1, 1)], mode="edge")
    rows, cols = pictures.shape[1:]
    around = [padded[:, i : i + rows, j : j + cols] for i in range(3) for j in range(3)]
    return (pictures > 0) & ~np.all(around, axis=0)


def learned_outlines_are_those_of_edge(names, said):
    """On pictures that were not learned from, and on those that were."""
    np.testing.assert_array_equal(names["outlines"] > 0, outlined(names["pictures"]))
    unseen = np.where(np.random.default_rng(1).random((20, 8, 8)) > 0.25, 1.0, -1.0)
    got = cnnum.Engine("numba").run(names["made"].template, input=unseen).output > 0
    assert (got == outlined(unseen)).mean() > 0.99


def a_press_is_one_that_comes(names, said):
    """The sphere comes down from 0.4 to 1 s, and the strain has just exceeded 0.03."""
    (event,) = names["scene"].collect(250).events
    assert 0.4 < event.time < 1.0
    assert 0.03 < event.strength < 0.04


def a_program_outlines_what_is_touched(names, said):
    """Of all 1,000 frames: whether anything is, and EDGE's answer to it."""
    touched = names["frames"][..., 2] > np.float32(0.1)
    np.testing.assert_array_equal(names["found"]["contact"], touched.any(axis=(1, 2)))
    np.testing.assert_array_equal(names["found"]["outline"] > 0, outlined(touched))
    assert touched.any()


def a_batch_has_a_template_a_row(names, said):
    """Each answers as it does alone, which differs: a state rests at its feedback and its drive."""
    picture = np.random.default_rng(2).uniform(-1.0, 1.0, (8, 8))
    found = cnnum.Engine().run(names["batch"], input=picture).state
    for row in (0, 500, 999):
        alone = replace(names["edge"], A=names["weights"][row])
        state = cnnum.Engine("reference").run(alone, input=picture).state
        np.testing.assert_allclose(found[row], state, atol=2e-3)
    assert np.abs(found[0] - found[999]).max() > 0.05


def edges_are_black_next_to_white(names, said):
    found = names["result"].output > 0
    np.testing.assert_array_equal(found, outlined(names["picture"][np.newaxis])[0])


def an_export_has_the_deepest_reading(names, said):
    """Of each frame of its vector, the largest number: no rounding after that of the input."""
    program, vector = names["exported"].program, names["exported"].vector
    deepest = program.outputs["deepest"]
    assert len(vector.frames) == len(vector.answers) > 2
    for frame, answer in zip(vector.frames, vector.answers, strict=True):
        ((name, given),) = frame.items()
        largest = real(program.arrays[name], given).max()
        found = real(program.arrays[deepest], answer[deepest])
        assert float(found.squeeze()) == pytest.approx(largest, abs=40.0 / 2**14)
        assert largest > 20.0


def a_skeleton_is_thin_and_hangs_together(names, said):
    """Of a black rectangle: one line within it, no cell of which fills a square with others."""
    found = names["thin"]["picture"] > 0
    assert ndimage.label(found, np.ones((3, 3)))[1] == 1
    assert not (found & ~(names["picture"][..., 0] > 0)).any()
    squares = [found[i : i + 6, j : j + 8] for i in (0, 1) for j in (0, 1)]
    assert not np.all(squares, axis=0).any()


def whole_matrix(template, n, mode):
    """Return A of all cells, beyond whose rim lie copies of it ("edge") or zeros ("constant")."""
    a, cells = template.A[0, 0], np.arange(n * n).reshape(n, n)
    reach, whole = len(a) // 2, np.zeros((n * n, n * n))
    beyond = np.pad(cells, reach, mode=mode, **({} if mode == "edge" else {"constant_values": -1}))
    for (i, j), weight in np.ndenumerate(a):
        seen = beyond[i : i + n, j : j + n].ravel()
        for cell in np.flatnonzero(seen >= 0):
            whole[cell, seen[cell]] += weight
    return whole


def the_step_is_two_over_the_fastest_rate(names, said):
    """Of the whole matrix of LAPLACE with a mirror at its rim."""
    n = 8
    rates = np.linalg.eigvals(whole_matrix(names["laplace"], n, "edge") - np.eye(n * n)).real
    assert cnnum.stability_bound(names["laplace"], (n, n), "euler").step == pytest.approx(
        2.0 / np.abs(rates).max(), rel=1e-9
    )


def noise_is_no_slip_in_whole_numbers(names, said):
    stream = names["plan"].stream()
    answers = [stream.push(frame) for frame in names["frames"][:30]]
    assert not any(answer["gross_slip"] for answer in answers)
    # a plan that answers nothing but 0 would have no level
    assert answers[-1]["slip_level"] == pytest.approx(0.4, abs=1e-4)


def a_chip_is_off_by_its_noise_and_its_mismatch(names, said):
    """Between the step of 7 bits over √12, 0.0045, and weights of 2 % off all at once."""
    assert 0.0045 < names["error"] < 0.05


def noise_on_a_chip_is_no_twist(names, said):
    assert len(names["answers"]) == 20
    assert not any(answer["twist"] for answer in names["answers"])
    assert names["answers"][-1]["twist_level"] == pytest.approx(0.1, abs=1e-4)


def holes_are_counted(names, said):
    picture = -np.ones((8, 8, 1))
    picture[1:5, 1:6] = 1.0
    picture[2:4, 2:5] = -1.0
    plan = cnnum.Engine("reference").compile(names["holes"], (8, 8), channels=("picture",))
    out = plan(picture)
    assert out["area"] == 6


def stiffness_is_that_of_the_matrix(names, said):
    """Of INTERP, whose rim is 0: fastest over slowest rate, and two over the fastest."""
    rates = np.linalg.eigvalsh(
        whole_matrix(cnnum.get_template("INTERP"), 8, "constant") - np.eye(64)
    )
    sizes = np.abs(rates)
    found = names["found"]
    assert found.stiffness == pytest.approx(sizes.max() / sizes.min(), rel=1e-6)
    # the bound is that of the waves of an endless array: 6 % below that of 8×8
    assert found.bounds["euler"].step == pytest.approx(2.0 / sizes.max(), rel=0.1)
    assert found.bounds["euler"].step <= 2.0 / sizes.max()


def proofs_say_what_has_settled(names, said):
    """EDGE after 5 τ has no cell on its way; HOLE after 1 τ has those of SciPy's solution."""
    hole, picture = cnnum.get_template("HOLE"), names["picture"]
    a = whole_matrix(hole, 8, "constant")
    white = a @ np.ones(64) - hole.A.sum()  # neighbours beyond the rim are white
    drive = 4.0 * picture.ravel() - 1.0 + white
    way = solve_ivp(
        lambda _, x: -x + a @ np.clip(x, -1.0, 1.0) + drive, (0.0, 1.0), np.ones(64),
        rtol=1e-9, atol=1e-9,
    )  # fmt: skip
    state = way.y[:, -1]
    assert f"{(np.abs(state) >= 1.0).sum()} saturated, at rest False" in said
    np.testing.assert_allclose(names["found"].state.ravel(), state, atol=2e-3)
    assert not names["found"].settled


def followed(rates, start, time):
    """Return the state of a row of cells after a time, by SciPy."""
    way = solve_ivp(rates, (0.0, time), start, rtol=1e-10, atol=1e-12, max_step=0.05)
    return way.y[:, -1]


def laplacian(x):
    """Return neighbour − cell, summed over both neighbours of a row with a mirror at its rim."""
    return np.diff(x, prepend=x[0]) * -1.0 + np.diff(x, append=x[-1])


def a_difference_of_a_half_is_none(names, said):
    assert names["result"].output.tolist() == [[-1.0, -1.0, -1.0, 1.0]]


def edges_stay_between_smooth_halves(names, said):
    def rates(_, x):
        flows = np.diff(x) * np.maximum(1.0 - np.abs(np.diff(x)) / 0.5, 0.0)
        return np.append(flows, 0.0) - np.insert(flows, 0, 0.0)

    state = followed(rates, [0.5, 0.7, -0.5, -0.7], 4.0)
    np.testing.assert_allclose(names["result"].state[0], state, atol=1e-3)
    assert state[1] - state[2] > 1.0  # the edge is where it was


def what_changed_is_seen(names, said):
    """u − u(t − 2) through a leak of one time constant, from 0."""
    end = (1.0 - np.exp(-2.0)) * np.array([[0.0, -1.0, 1.0]])
    np.testing.assert_allclose(names["result"].output, end, atol=1e-3)


def contrast_is_the_picture_less_its_blur(names, said):
    """At rest: x = 0.2 (neighbours above, below, left, right, input); two of them are mirrors."""
    u = np.array([-0.5, -0.5, 0.5, 0.5])
    blur = np.eye(4) * 0.4 + 0.2 * (np.eye(4, k=1) + np.eye(4, k=-1))
    blur[0, 0] = blur[3, 3] = 0.6
    blurred = np.linalg.solve(np.eye(4) - blur, 0.2 * u)
    np.testing.assert_allclose(names["blurred"][0], blurred, atol=1e-3)
    np.testing.assert_allclose(names["contrast"][0], u - blurred, atol=1e-3)


def the_picture_comes_into_focus(names, said):
    u = np.array([0.0, 0.0, 1.0, 0.0])

    def rates(time, x):
        return u - x + 2.0 * max(1.0 - time / 8.0, 0.0) * laplacian(x)

    way = followed(rates, np.zeros(4), 12.0)
    np.testing.assert_allclose(names["result"].state[0], way, atol=1e-3)
    assert np.abs(way - u).max() < 0.1 < np.abs(followed(rates, np.zeros(4), 4.0) - u).max()


def a_bias_map_is_a_threshold(names, said):
    assert names["result"].output.tolist() == [[-1.0, 1.0, -1.0, 1.0]]


def a_membrane_is_straight_between_what_holds_it(names, said):
    np.testing.assert_allclose(names["result"].state, [[-0.9, -0.3, 0.3, 0.9]], atol=1e-3)


BEYOND = "docs/how-to/beyond-linear.md"


def test_files_and_python_of_a_page_are_the_same_templates():
    from docs.figures.beyond_linear import templates

    made = []
    for name, code, _ in FOUND:
        if name.startswith(BEYOND):
            built = code.partition("result =")[0]  # without the run
            names = {"__name__": "page"}
            exec(compile(built, "page", "exec"), names)
            made.append(names["template"])
    assert made == list(templates().values())
    assert len(made) == 7


def test_a_mirror_is_that_of_the_page():
    """Two cells beyond the rim lies the second cell, one beyond it the first."""
    west = np.zeros((5, 5))
    west[2, 0] = 1.0
    template = cnnum.Template("west", [[0.0]], west, boundary="zero-flux", duration=40.0)
    row = np.array([[0.1, 0.2, 0.3, 0.4]])
    state = cnnum.Engine("reference").run(template, input=row).state
    np.testing.assert_allclose(state, np.pad(row, ((0, 0), (2, 0)), "symmetric")[:, :4], atol=1e-6)
    words = " ".join((ROOT / BEYOND).read_text().split())
    assert f"have the values {', '.join(f'{value:.1f}' for value in state[0])}." in words


HELD = {
    f"{BEYOND}-0": a_difference_of_a_half_is_none,
    f"{BEYOND}-1": edges_stay_between_smooth_halves,
    f"{BEYOND}-2": what_changed_is_seen,
    f"{BEYOND}-3": contrast_is_the_picture_less_its_blur,
    f"{BEYOND}-4": the_picture_comes_into_focus,
    f"{BEYOND}-5": a_bias_map_is_a_threshold,
    f"{BEYOND}-6": a_membrane_is_straight_between_what_holds_it,
    "docs/how-to/program.md-0": a_program_outlines_what_is_touched,
    "docs/how-to/program.md-3": a_press_is_one_that_comes,
    "docs/how-to/template.md-1": a_batch_has_a_template_a_row,
    "docs/methods.md-1": edges_are_black_next_to_white,
    "docs/microcontrollers.md-0": an_export_has_the_deepest_reading,
    "docs/programs-by-example.md-4": a_skeleton_is_thin_and_hangs_together,
    "README.md-0": corners_are_four,
    "README.md-1": edges_are_those_of_the_punch,
    "docs/adding.md-0": a_product_settles_where_its_equation_does,
    "docs/how-to/learn.md-0": learned_outlines_are_those_of_edge,
    "docs/methods.md-3": the_step_is_two_over_the_fastest_rate,
    "docs/microcontrollers.md-1": noise_is_no_slip_in_whole_numbers,
    "docs/microcontrollers.md-2": a_chip_is_off_by_its_noise_and_its_mismatch,
    "docs/microcontrollers.md-3": noise_on_a_chip_is_no_twist,
    "docs/programs-by-example.md-1": holes_are_counted,
    "docs/stability.md-0": stiffness_is_that_of_the_matrix,
    "docs/stability.md-1": proofs_say_what_has_settled,
}
"""The truth of code that neither asserts nor shows what it prints."""

DEFINED = {
    "docs/recordings.md-0": "tests/drivers/test_recorded_bytes.py decodes such bytes",
    "docs/how-to/program.md-2": "the next block of the page runs it",
}
"""Code that only defines something, and where that is held."""


@pytest.mark.parametrize(("name", "code", "shown"), BLOCKS)
def test_code_runs_as_shown(name, code, shown, capsys, tmp_path, monkeypatch):
    """It prints what the page shows, and what it finds is held to a truth of its own."""
    monkeypatch.chdir(tmp_path)  # for what it writes
    names = {"__name__": "page"}
    exec(compile(code, "page", "exec"), names)
    said = capsys.readouterr().out
    if shown:
        assert " ".join(said.split()) == " ".join(shown.split())
    if name in HELD:
        HELD[name](names, said)


def test_all_code_is_held_to_something():
    for name, code, shown in FOUND:
        assert shown or name in HELD or name in DEFINED or re.search(r"^ *assert ", code, re.M), (
            name
        )
    assert {name for name, _, _ in FOUND} >= {*HELD, *DEFINED}


def test_readme_has_code():
    assert len(BLOCKS) >= 2


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)#]+?)(?:#[^)]*)?\)", page.read_text()):
        if not target.startswith(("http:", "https:")):
            assert (page.parent / target).exists(), f"{page.name} links to {target}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_no_line_is_lost_as_a_comment(page):
    """The site leaves out a line that begins with a percent sign: one that is wrapped there."""
    prose = re.sub(r"```.*?```", "", page.read_text(), flags=re.DOTALL)
    assert not re.findall(r"^ {0,3}%.*", prose, re.MULTILINE)


def test_the_template_of_the_first_example_is_the_librarys():
    assert cnnum.get_template("CORNER").z[0] == -5.0
