"""Strain to volts and back; calibrations on disk."""

from pathlib import Path

import numpy as np
import pytest

from cnnum.errors import ArrayError, CalibrationError, UnknownNameError
from cnnum.tactile import halfspace
from cnnum.tactile.taxel import Bridge, Calibration, Coupling, Heat, Readout, Taxel

E, Z = 0.87e6, 200e-6


def array(rng: np.random.Generator) -> Taxel:
    """Return an 8×8 array with everything that can be wrong with one, but noise."""
    cross = np.eye(3) + 0.1 * rng.normal(size=(8, 8, 3, 3))
    return Taxel(
        Coupling.nominal(depth=Z, youngs_modulus=E, cross=cross),
        Bridge(transversal=1e9),
        Readout(bits=None, offsets=0.1 * rng.normal(size=(8, 8, 4)), heat=Heat(10e-3, 60.0)),
    )


def test_strain_comes_back_from_the_volts() -> None:
    rng = np.random.default_rng(5)
    taxel = array(rng)
    strain = 1e-3 * rng.normal(size=(2000, 8, 8, 3))
    time = np.arange(2000) / 60.0
    reading = taxel.read(strain, time=time)
    assert reading.good.all()
    calibration = taxel.calibration()
    back = calibration.to_strain(reading.volts, time=time)
    # Rounding of volts near 0.1 V, by a strain of 0.1 a volt and a condition near 3.
    np.testing.assert_allclose(back, strain, atol=1e-15)
    for names in (("normal",), ("shear_y", "shear_x"), "shear_x"):
        part = calibration.to_strain(reading.volts, names, time=time)
        chosen = [("shear_x", "shear_y", "normal").index(n) for n in np.atleast_1d(names)]
        np.testing.assert_allclose(part, strain[..., chosen], atol=1e-15)


def test_signals_are_the_combinations_of_4_14() -> None:
    left, right, top, bottom = volts = np.array([0.1, -0.2, 0.4, 0.8])
    signals = Calibration(alpha_normal=2.0).to_signals(volts)
    expected = [-(right - left), -(top - bottom), -(left + right + bottom + top) / 2.0]
    np.testing.assert_allclose(signals, expected, rtol=1e-15)
    strain = Calibration(alpha_normal=2.0, beta_ns=1.5).to_strain(volts)
    np.testing.assert_allclose(strain, -np.array([3.0, 3.0, 2.0]) * expected, rtol=1e-15)


def test_only_the_bridges_of_wanted_channels_are_read() -> None:
    ideal = Calibration(alpha_normal=1.0)
    assert ideal.bridges("shear_x") == ("left", "right")
    assert ideal.bridges(("shear_y",)) == ("top", "bottom")
    assert ideal.bridges() == ("left", "right", "top", "bottom")
    volts = np.array([1.0, 2.0, 1e300, -1e300])
    assert ideal.to_signals(volts, ("shear_x",))[0] == -1.0


def test_nominal_taxel_shows_the_figures_of_merit_of_the_half_space() -> None:
    taxel = Taxel(Coupling.nominal(depth=Z, youngs_modulus=E), readout=Readout(bits=None))
    x = np.linspace(-4.0, 4.0, 801) * Z
    load = np.array([0.0, 0.0, 1e-3])
    strain = halfspace.strain(-x, 0.0, Z, load, youngs_modulus=E)[:, np.newaxis, 2, :]
    volts = taxel.read(strain[:, np.newaxis]).volts
    signals = taxel.calibration().to_signals(volts)[:, 0, 0]
    normal, shear = signals[:, 2], signals[:, 0]
    # Extrema at x = 0, 2z and z/2 are points of the grid: closed forms to rounding.
    assert normal.max() / -normal.min() == pytest.approx(5.0**2.5, rel=1e-9)
    assert normal.max() / shear.max() == pytest.approx(1.5 * 25.0 * np.sqrt(5.0) / 24.0, rel=1e-9)
    # Covered ten times less than bare (Table 3.II: 5–30): S_n = 2 · gain · ΔV of one bridge.
    bare = -2.0 * 55.0 * Bridge().voltages(load)[0]
    assert normal.max() == pytest.approx(bare / 10.0, rel=1e-9)
    # A load to the left of the taxel pushes it to the right.
    assert shear[x < 0.0].min() > 0.0


def test_strain_noise_is_what_noise_does() -> None:
    rng = np.random.default_rng(7)
    taxel = Taxel(Coupling.nominal(), readout=Readout(bits=None))
    calibration = taxel.calibration()
    read = taxel.read(np.zeros((20000, 1, 1, 3)), rng=rng)
    spread = calibration.to_strain(read.volts).std(axis=(0, 1, 2))
    shear, normal = calibration.strain_noise(2.5e-3)
    # 20 000 draws know a deviation to 0.5 %; four of those.
    np.testing.assert_allclose(spread, [shear, shear, normal], rtol=0.02)


def test_saturation_and_overload_are_flagged_never_silent() -> None:
    taxel = Taxel(Coupling.nominal())
    strain = np.zeros((3, 1, 2, 3))
    strain[1, 0, 1, 2] = -0.5  # some 3.5 mN on silicon: within its strength, beyond ±2.5 V
    strain[2, 0, 0, 2] = -2.5
    reading = taxel.read(strain)
    assert reading.saturated.any(axis=-1)[:, 0].tolist() == [
        [False, False],
        [False, True],
        [True, False],
    ]
    assert reading.overloaded[:, 0].tolist() == [[False, False], [False, False], [True, False]]
    np.testing.assert_array_equal(reading.good, ~(reading.saturated.any(-1) | reading.overloaded))
    np.testing.assert_array_equal(taxel.calibration().saturated(reading.volts), reading.saturated)


def test_calibration_and_converter_agree_on_what_is_saturated() -> None:
    taxel = Taxel(Coupling.nominal(), readout=Readout(limit=0.3, bits=8))
    strain = np.zeros((2001, 1, 1, 3))
    strain[:, 0, 0, 2] = np.linspace(-0.2, 0.2, 2001)  # both ends of the range, code by code
    reading = taxel.read(strain)
    assert 0 < np.count_nonzero(reading.saturated) < reading.saturated.size
    np.testing.assert_array_equal(taxel.calibration().saturated(reading.volts), reading.saturated)


def test_a_calibration_survives_its_file(tmp_path: Path) -> None:
    calibration = array(np.random.default_rng(9)).calibration(depth=Z)
    path = tmp_path / "array.toml"
    calibration.save(path)
    back = Calibration.load(path)
    for name in ("alpha_normal", "beta_ns", "limit", "depth", "heat"):
        assert getattr(back, name) == getattr(calibration, name)
    for name in ("offsets", "cross", "drift"):
        np.testing.assert_array_equal(getattr(back, name), getattr(calibration, name))
    assert [file.name for file in tmp_path.iterdir()] == ["array.toml"]


def test_a_failed_write_leaves_the_old_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "array.toml"
    Calibration(alpha_normal=1.0).save(path)
    before = path.read_bytes()

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(CalibrationError, match="No space left"):
        Calibration(alpha_normal=2.0).save(path, force=True)
    assert path.read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == ["array.toml"]


HEAD = 'kind = "taxel calibration"\nalpha_normal = 1.0\n'


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ("alpha_normal = 1.0\n", "kind"),
        ('kind = "taxel calibration"\n', "alpha_normal"),
        ('kind = "scene"\nalpha_normal = 1.0\n', "kind"),
        (HEAD + "beta_ns = true\n", "beta_ns"),
        (HEAD + "beta_ns = -1.0\n", "beta_ns"),
        (HEAD + "betans = 1.0\n", "betans"),
        (HEAD + 'offsets = ["a"]\n', "offsets"),
        (HEAD + "offsets = [1.0, 2.0]\n", "offsets"),
        (HEAD + "cross = [[1.0, 0.0], [0.0]]\n", "cross"),
        (HEAD + "cross = [[1.0, 0, 0], [1.0, 0, 0], [0, 0, 1.0]]\n", "cross"),
        (HEAD + "[heat]\nampl = 1.0\n", "heat.ampl"),
        (HEAD + "[heat]\ntime_constant = 0.0\n", "heat"),
        (HEAD + "depth = nan\n", "depth"),
        (HEAD + "= 3", "TOML"),
    ],
)
def test_a_wrong_file_is_one_sentence_with_file_and_key(
    tmp_path: Path, text: str, key: str
) -> None:
    path = tmp_path / "wrong.toml"
    path.write_text(text)
    with pytest.raises(CalibrationError) as caught:
        Calibration.load(path)
    assert str(path) in str(caught.value)
    assert key in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(CalibrationError, match=r"none\.toml"):
        Calibration.load(tmp_path / "none.toml")


def test_wrong_arguments_are_refused() -> None:
    calibration = Calibration(alpha_normal=1.0)
    with pytest.raises(UnknownNameError, match="shear_z"):
        calibration.to_strain(np.zeros(4), ("shear_z",))
    with pytest.raises(ArrayError):
        calibration.to_strain(np.zeros(3))
    with pytest.raises(ArrayError):
        calibration.to_strain([np.nan, 0.0, 0.0, 0.0])
