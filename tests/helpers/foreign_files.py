"""Twelve files as other programs write them, all with one press at 1 s: ``write(folder)``.

A load of Gaussian shape comes in 0.3 s and stays; the cover moves away from its centre, so that
the shear points outwards.
"""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

RATE, FRAMES, PRESSED = 100.0, 300, 1.0


def press(rows, cols, seed=0, offset=0.0, noise=2.0, size=400.0, axes=3):
    """(frames, rows, cols, axes) counts; the centre lies off the middle."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:rows, :cols]
    dy, dx = y - (0.6 * rows - 0.5), x - (0.4 * cols - 0.5)
    width = 0.3 * max(min(rows, cols), 2)
    shape = np.exp(-(dx**2 + dy**2) / (2 * width**2))
    load = np.stack([0.5 * dx / width * shape, 0.5 * dy / width * shape, shape], axis=-1)
    time = np.arange(FRAMES) / RATE
    grown = np.clip((time - PRESSED) / 0.3, 0.0, 1.0)
    values = offset + rng.normal(0.0, noise, (FRAMES, rows, cols, 3))
    values += size * grown[:, None, None, None] * load
    return values if axes == 3 else values[..., 2:]


def times():
    return np.arange(FRAMES) / RATE


def xela_log(folder):
    """Messages of XELA's server, a line each."""
    counts = np.rint(press(4, 4, offset=32_768)).astype(int)
    lines = []
    for n, frame in enumerate(counts):
        data = ",".join(f"{value:04X}" for value in frame.ravel())
        one = {"sensor": 1, "time": 1.7e9 + n / RATE, "model": "XR1944", "taxels": 16, "data": data}
        lines.append(json.dumps({"message": n, "1": one, "calibrated": None}))
    path = folder / "xela.jsonl"
    path.write_text("\n".join(lines) + "\n")
    return path


def flexitac_counts(folder):
    """A table without a header: a time in ms, and 12×32 counts of one axis."""
    counts = np.clip(np.rint(press(12, 32, axes=1, size=150, offset=12)), 0, 255).astype(int)
    rows = np.column_stack([np.rint(1e3 * times()).astype(int), counts.reshape(FRAMES, -1)])
    path = folder / "flexitac.csv"
    np.savetxt(path, rows, fmt="%d", delimiter=",")
    return path


def anyskin(folder):
    """Blanks between B0x, B0y, B0z, …, as a logger of AnySkin writes; the times since 1970."""
    values = press(1, 5, noise=0.5)
    names = " ".join(f"B{n}{axis}" for n in range(5) for axis in "xyz")
    path = folder / "anyskin.txt"
    rows = np.column_stack([1.7e9 + times(), values.reshape(FRAMES, -1)])
    np.savetxt(path, rows, fmt="%.6f", header=f"timestamp {names}")
    return path


def contactile(folder):
    """A 3×3 sensor of pillars with forces in newtons, times in µs, and a comma at the end."""
    values = press(3, 3, noise=0.01, size=4.0)
    head = [f"S0_P{n}_F{axis} (N)" for n in range(9) for axis in "xyz"]
    lines = [",".join(["T_us", *head]) + ","]
    for n, frame in enumerate(values):
        lines.append(",".join([str(10_000 * n), *(f"{v:.5f}" for v in frame.ravel())]) + ",")
    path = folder / "contactile.csv"
    path.write_text("\r\n".join(lines) + "\r\n")
    return path


def pandas_export(folder):
    """A data frame with its index, dates, and the words of pandas for missing values."""
    pd = pytest.importorskip("pandas")
    values = press(4, 4, offset=16_000)
    columns = {"time": pd.Timestamp("2024-05-03 12:00:00") + pd.to_timedelta(times(), unit="s")}
    for n in range(16):
        columns |= {f"taxel{n + 1}_{a}": values[:, n // 4, n % 4, c] for c, a in enumerate("xyz")}
    path = folder / "frame.csv"
    pd.DataFrame(columns).to_csv(path)
    return path


def uskin_hdf5(folder):
    """Taxels in one axis, beside pictures and joints of a robot; times of the shape (n, 1)."""
    h5py = pytest.importorskip("h5py")
    path = folder / "episode_0.h5"
    with h5py.File(path, "w") as file:
        file["observations/tactile"] = press(4, 4, offset=30_000).reshape(FRAMES, 16, 3)
        file["observations/qpos"] = np.zeros((FRAMES, 7))
        file["observations/images/top"] = np.zeros((FRAMES, 8, 8, 3), np.uint8)
        file["timestamp"] = (1.7e9 + times())[:, np.newaxis]
    return path


def tekscan(folder):
    """A head, then a block of rows a frame, as the ASCII files of Tekscan's movies."""
    values = np.clip(np.rint(press(8, 10, axes=1, size=200, offset=4, noise=0.6)), 0, 255)
    lines = ["DATA_TYPE MOVIE", "ROWS 8", "COLS 10", "SECONDS_PER_FRAME 0.01", "UNITS kPa", ""]
    lines.append("ASCII_DATA @@")
    for n, frame in enumerate(values[..., 0].astype(int), 1):
        lines += [f"Frame {n}", *(",".join(map(str, row)) for row in frame.tolist()), ""]
    path = folder / "movie.asc"
    path.write_text("\r\n".join([*lines, "@@", ""]))
    return path


def rosbag2(folder):
    """A folder of ROS 2 with Float32MultiArray messages."""
    pytest.importorskip("rosbags", reason="the extra 'bags' is not installed")
    from rosbags.rosbag2 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    of = store.types
    array, layout = "std_msgs/msg/Float32MultiArray", "std_msgs/msg/MultiArrayLayout"
    path = folder / "bag"
    with Writer(path, version=9) as writer:
        connection = writer.add_connection("/tactile", array, typestore=store)
        for n, frame in enumerate(press(4, 4, offset=1000)):
            flat = np.asarray(frame.ravel(), np.float32)
            message = of[array](of[layout]([], 0), flat)
            stamp = 1_700_000_000_000_000_000 + n * 10_000_000
            writer.write(connection, stamp, store.serialize_cdr(message, array))
    return path


def mcap_json(folder):
    """JSON messages, as a browser's or a Foxglove bridge's recorder writes them."""
    from mcap.writer import Writer

    path = folder / "touch.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("Touch", "jsonschema", b"{}")
        channel = writer.register_channel("/skin", "json", schema)
        for n, frame in enumerate(press(4, 4, offset=1000)):
            three = frame.reshape(-1, 3).tolist()
            taxels = [dict(zip("xyz", one, strict=True)) for one in three]
            data = json.dumps({"seq": n, "taxels": taxels}).encode()
            stamp = 1_700_000_000_000_000_000 + n * 10_000_000
            writer.add_message(channel, stamp, data, stamp)
        writer.finish()
    return path


def lerobot_parquet(folder):
    """An episode of LeRobot's layout with a column of taxels."""
    pa = pytest.importorskip("pyarrow")
    pq = pytest.importorskip("pyarrow.parquet")
    values = press(4, 4, offset=1000).astype(np.float32)
    path = folder / "episode_000000.parquet"
    columns = {
        "observation.state": pa.array([[0.0] * 6] * FRAMES, pa.list_(pa.float32())),
        "observation.tactile": pa.array(values.reshape(FRAMES, 16, 3).tolist()),
        "timestamp": pa.array(times().astype(np.float32)),
        "frame_index": pa.array(range(FRAMES)),
    }
    pq.write_table(pa.table(columns), path)
    return path


def npy_pads(folder):
    """Two pads side by side in an array of (frames, rows, cols, axes); the rate is not in it."""
    both = np.concatenate([press(4, 4, seed=1, offset=900), press(4, 4, seed=2, offset=900)], 2)
    path = folder / "pads.npy"
    np.save(path, both.astype(np.float32))
    return path


def fortran(folder):
    """An array of MATLAB's order, with the frames last."""
    path = folder / "matlab.npz"
    values = np.asfortranarray(press(6, 4, offset=900).transpose(1, 2, 3, 0))
    np.savez(path, tactile=values, t=times())
    return path


FILES: dict[str, tuple[Callable[[Path], Path], tuple[str, ...]]] = {
    "XELA log": (xela_log, ()),
    "FlexiTac counts": (flexitac_counts, ()),
    "AnySkin": (anyskin, ()),
    "Contactile": (contactile, ()),
    "pandas export": (pandas_export, ()),
    "HDF5 of a uSkin set": (uskin_hdf5, ()),
    "Tekscan text": (tekscan, ()),
    "rosbag2 folder": (rosbag2, ()),
    "MCAP with JSON": (mcap_json, ()),
    "Parquet of LeRobot": (lerobot_parquet, ()),
    "npy with pads": (npy_pads, ("--set", f"rate={RATE}", "--set", "pads=2")),
    "Fortran order, frames last": (fortran, ()),
}
"""Name to the function that writes the file, and to what its user knows and it does not say."""
