"""The template library: every name finds its template, and every file is in order."""

import subprocess
import sys

import numpy as np
import pytest

import cnnum.templating.library as library
from cnnum.errors import UnknownNameError
from cnnum.templating.checks import form_of
from cnnum.templating.files import load_entry

NAMES = library.template_names()
BUILDING_BLOCKS = {"tactile_diffusion", "tactile_edge", "gradient_x", "gradient_y", "shear_curl"}


def test_names_are_sorted_and_hold_the_classics_and_the_tactile_ones() -> None:
    assert list(NAMES) == sorted(NAMES, key=str.lower)
    assert {"EDGE", "HOLE", "CCD_HOR", "RECALL", "DIFFUS", *BUILDING_BLOCKS} <= set(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_file_is_named_as_its_template_and_says_what_it_is(name: str) -> None:
    path = library.template_path(name)
    template = library.get_template(name)
    assert path.stem == name.lower()
    assert template.name == name
    assert len(template.description) > 40
    assert template.source
    assert form_of(template).name
    about = library.get_entry(name).about
    assert about.input
    assert about.state
    assert about.tags


def test_most_templates_have_a_definition_of_their_own() -> None:
    experimental = [name for name in NAMES if library.get_entry(name).about.experimental]
    assert len(experimental) <= 0.15 * len(NAMES)
    weak = {name for name in NAMES if library.get_template(name).check.name.startswith("refined")}
    anisotropic = {"D_ANISOB", "D_ANISOL", "MATCNN_ANISO", "MATCNN_ANISOC"}
    assert weak <= {*experimental, *anisotropic}


@pytest.mark.parametrize("name", NAMES)
def test_measured_figures_are_those_of_the_numbers(name: str) -> None:
    entry = library.get_entry(name)
    assert entry.measured is not None
    assert entry.measured.digest == entry.template.digest


@pytest.mark.parametrize("spelling", ["EDGE", "edge", "Edge", "EdgeDetector", "EDGEDETECTION"])
def test_case_does_not_matter_and_aliases_count(spelling: str) -> None:
    assert library.get_template(spelling).name == "EDGE"


@pytest.mark.parametrize(
    ("alias", "name"),
    [("LOCMAX", "MATCNN_LOCMAX"), ("PoissonPDESolver", "POISSON"), ("SKELE3", "MATCNN_SKELE3")],
)
def test_a_name_that_only_its_source_uses_finds_it(alias: str, name: str) -> None:
    assert library.get_template(alias).name == name


def test_no_name_means_two_templates() -> None:
    owners: dict[str, str] = {}
    for name in NAMES:
        entry = load_entry(library.template_path(name))
        for spelling in {name.lower(), *(alias.lower() for alias in entry.aliases)}:
            assert owners.setdefault(spelling, name) == name


def test_unknown_name_offers_the_nearest_ones() -> None:
    with pytest.raises(UnknownNameError, match=r"Unknown template 'EDGY': .*'EDGE'"):
        library.get_template("EDGY")
    with pytest.raises(LookupError, match=r"cnnum\.template_names\(\) lists all"):
        library.template_path("qqqqqq")


def test_same_template_comes_back_each_time() -> None:
    assert library.get_template("hole") is library.get_template("HOLE")


def test_one_name_reads_one_file_and_needs_no_heavy_library() -> None:
    script = (
        "import sys; from cnnum.templating import library; library.get_template('EDGE');"
        "assert library._load.cache_info().currsize == 1;"
        "assert not {'scipy', 'pyopencl', 'numba'} & sys.modules.keys()"
    )
    subprocess.run([sys.executable, "-c", script], check=True, timeout=60)


def test_hole_and_component_templates_have_a_white_frame() -> None:
    for name in ("HOLE", "RECALL", "CCD_HOR", "CCD_VERT", "CCD_DIAG", "SHADOW", "CONNECTI"):
        assert library.get_template(name).boundary.constant == -1.0
        assert library.get_entry(name).about.published_boundary in ("0", "zero-flux")


def test_figrec_and_recall_differ_as_their_files_do() -> None:
    """FIGREC.tem and RECALL.tem have the same couplings; their currents are 3 and 2.5."""
    figrec, recall = library.get_template("FIGREC"), library.get_template("RECALL")
    around, centre = np.full((3, 3), 0.5), np.zeros((3, 3))
    around[1, 1] = centre[1, 1] = 4.0
    for template, current in ((figrec, 3.0), (recall, 2.5)):
        np.testing.assert_array_equal(template.A[0, 0], around)
        np.testing.assert_array_equal(template.B[0, 0], centre)
        assert template.z.tolist() == [current]
    assert figrec.digest != recall.digest
    assert library.get_template("FigureReconstructor") is recall
