"""A press as a robot might log it, written in every format that is read."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from palpate.domain import FloatArray
from palpate_robot_log.reading.channel_map import ChannelMap

Table = dict[str, FloatArray]

COLUMNS = (
    *("time_s", "x_m", "y_m", "z_m", "qx", "qy", "qz", "qw"),
    *("fx_N", "fy_N", "fz_N", "tx_Nm", "ty_Nm", "tz_Nm"),
)
MAP: Mapping[str, Any] = {
    "time": "time_s",
    "position": {"columns": ["x_m", "y_m", "z_m"]},
    "orientation": {"columns": ["qx", "qy", "qz", "qw"]},
    "force": {"columns": ["fx_N", "fy_N", "fz_N"]},
    "moment": {"columns": ["tx_Nm", "ty_Nm", "tz_Nm"]},
}


def channel_map(**changes: Any) -> ChannelMap:
    return ChannelMap.model_validate({**MAP, **changes})


def press(n_rows: int = 240, rate_hz: float = 200.0, seed: int = 1) -> Table:
    """Free air, a press, a turn; positions in m, moments in N·m, with noise."""
    rng = np.random.default_rng(seed)
    time = np.round(np.arange(n_rows) / rate_hz, 9)
    way = np.clip(np.linspace(-0.004, 0.010, n_rows), None, 0.008)
    angle = 0.3 * np.sin(2.0 * np.pi * np.linspace(0.0, 1.0, n_rows))
    force = -1.5e5 * np.clip(way, 0.0, None) ** 2
    table = {
        "time_s": time,
        "x_m": 0.4 + 0.1 * way,
        "y_m": -0.2 + 0.05 * way,
        "z_m": 0.3 - way,
        "qx": np.cos(angle / 2.0) * 0.8,
        "qy": np.cos(angle / 2.0) * 0.6,
        "qz": np.sin(angle / 2.0) * 0.6,
        "qw": np.sin(angle / 2.0) * -0.8,
    }
    for index, name in enumerate(("fx_N", "fy_N", "fz_N")):
        table[name] = 0.3 * index + (force if name == "fz_N" else 0.0) + 0.04 * rng.standard_normal(n_rows)
    for index, name in enumerate(("tx_Nm", "ty_Nm", "tz_Nm")):
        twist = -0.05 * angle if name == "tz_Nm" else 0.0
        table[name] = 1e-3 * index + twist + 2.5e-4 * rng.standard_normal(n_rows)
    return table


def write_text(
    path: Path, table: Mapping[str, FloatArray], delimiter: str = ",", decimal: str = ".", head: str = ""
) -> None:
    lines = [delimiter.join(table)]
    rows = np.column_stack(list(table.values())).tolist()
    lines += [delimiter.join(repr(value).replace(".", decimal) for value in row) for row in rows]
    path.write_text(head + "\n".join(lines) + "\n", encoding="utf-8")


def write_parquet(path: Path, table: Mapping[str, FloatArray]) -> None:
    import polars as pl

    pl.DataFrame(dict(table)).write_parquet(path)


def write_npz(path: Path, table: Mapping[str, FloatArray]) -> None:
    np.savez_compressed(path, allow_pickle=False, **table)


def write_npy(path: Path, table: Mapping[str, FloatArray]) -> None:
    array = np.zeros(len(table["time_s"]), dtype=[(name, "f8") for name in table])
    for name, values in table.items():
        array[name] = values
    np.save(path, array)


def write_matlab5(path: Path, table: Mapping[str, FloatArray], *, compressed: bool = True) -> None:
    from scipy.io import savemat

    savemat(path, {"log": dict(table)}, do_compression=compressed, oned_as="column")


def write_matlab73(path: Path, table: Mapping[str, FloatArray]) -> None:
    """As MATLAB lays it out: a user block that names it, dimensions reversed, a class for each variable."""
    import h5py

    with h5py.File(path, "w", userblock_size=512) as file:
        group = file.create_group("log")
        group.attrs["MATLAB_class"] = np.bytes_("struct")
        for name, values in table.items():
            data = group.create_dataset(name, data=values.reshape(1, -1), chunks=True, compression="gzip")
            data.attrs["MATLAB_class"] = np.bytes_("double")
    with path.open("r+b") as stream:
        stream.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")


def write_hdf5(path: Path, table: Mapping[str, FloatArray]) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        for name, values in table.items():
            file[f"log/{name}"] = values


# --------------------------------------------------------------------------- bags

START_NS = 1_700_000_000_000_000_000
BAG_MAP: Mapping[str, Any] = {
    "time": "stamp",
    "position": {"columns": [f"pose.position.{a}" for a in "xyz"]},
    "orientation": {"columns": [f"pose.orientation.{a}" for a in "xyzw"]},
    "force": {"columns": [f"wrench.force.{a}" for a in "xyz"]},
    "moment": {"columns": [f"wrench.torque.{a}" for a in "xyz"]},
}


def bag_map(**changes: Any) -> ChannelMap:
    return ChannelMap.model_validate({**BAG_MAP, **changes})


def _messages(store: Any, wrench: Table, pose: Table) -> list[tuple[int, str, Any]]:
    """Stamped messages of both topics in order of time."""
    types = store.types

    def header(seconds: float, frame: str) -> Any:
        stamp_ns = START_NS + round(seconds * 1e9)
        stamp = types["builtin_interfaces/msg/Time"](sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
        made = types["std_msgs/msg/Header"]
        extra = {"seq": 0} if "seq" in made.__dataclass_fields__ else {}
        return made(stamp=stamp, frame_id=frame, **extra)

    def vector(table: Table, row: int, names: tuple[str, ...], kind: str) -> Any:
        values = (float(table[name][row]) for name in names)
        return types[f"geometry_msgs/msg/{kind}"](**dict(zip("xyzw", values, strict=False)))

    found = []
    for row, seconds in enumerate(wrench["time_s"]):
        content = types["geometry_msgs/msg/Wrench"](
            force=vector(wrench, row, COLUMNS[8:11], "Vector3"),
            torque=vector(wrench, row, COLUMNS[11:14], "Vector3"),
        )
        message = types["geometry_msgs/msg/WrenchStamped"](header=header(seconds, "ft"), wrench=content)
        found.append((START_NS + round(seconds * 1e9) + 50_000, "/wrench", message))
    for row, seconds in enumerate(pose["time_s"]):
        content = types["geometry_msgs/msg/Pose"](
            position=vector(pose, row, COLUMNS[1:4], "Point"),
            orientation=vector(pose, row, COLUMNS[4:8], "Quaternion"),
        )
        message = types["geometry_msgs/msg/PoseStamped"](header=header(seconds, "base"), pose=content)
        found.append((START_NS + round(seconds * 1e9) + 80_000, "/tool/pose", message))
    return sorted(found, key=lambda one: one[0])


def write_bag1(path: Path, wrench: Table, pose: Table | None = None, compression: str = "") -> None:
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    writer = Writer(path)
    if compression:
        writer.set_compression(Writer.CompressionFormat[compression])
    with writer:
        _write_all(writer, store, wrench, pose, store.serialize_ros1)


def write_bag2(
    path: Path, wrench: Table, pose: Table | None = None, storage: str = "SQLITE3", compression: str = ""
) -> None:
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    writer = Writer(path, version=9, storage_plugin=StoragePlugin[storage])
    if compression:
        writer.set_compression(CompressionMode[compression], CompressionFormat.ZSTD)
    with writer:
        _write_all(writer, store, wrench, pose, store.serialize_cdr)


def _write_all(
    writer: Any, store: Any, wrench: Table, pose: Table | None, serialise: Callable[..., Any]
) -> None:
    topics = {
        "/wrench": "geometry_msgs/msg/WrenchStamped",
        "/tool/pose": "geometry_msgs/msg/PoseStamped",
    }
    connections = {
        topic: writer.add_connection(topic, kind, typestore=store) for topic, kind in topics.items()
    }
    for time_ns, topic, message in _messages(store, wrench, wrench if pose is None else pose):
        writer.write(connections[topic], time_ns, serialise(message, topics[topic]))


def write_transforms(path: Path, frames: Mapping[str, list[tuple[str, str]]]) -> Path:
    """Thirty messages of transforms for each topic, one if it is static; y is the number of a transform."""
    from rosbags.rosbag2 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    types, kind = store.types, "tf2_msgs/msg/TFMessage"
    with Writer(path, version=9) as writer:
        for topic, pairs in frames.items():
            connection = writer.add_connection(topic, kind, typestore=store)
            for row in range(1 if topic.endswith("static") else 30):
                stamp = types["builtin_interfaces/msg/Time"](sec=5, nanosec=row * 10**6)
                transforms = [
                    types["geometry_msgs/msg/TransformStamped"](
                        header=types["std_msgs/msg/Header"](stamp=stamp, frame_id=parent),
                        child_frame_id=child,
                        transform=types["geometry_msgs/msg/Transform"](
                            translation=types["geometry_msgs/msg/Vector3"](
                                x=float(row), y=float(place), z=0.0
                            ),
                            rotation=types["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0),
                        ),
                    )
                    for place, (parent, child) in enumerate(pairs, start=1)
                ]
                message = types[kind](transforms=transforms)
                writer.write(connection, row * 10**6, store.serialize_cdr(message, kind))
    return path


def write_chain(path: Path, time_s: FloatArray, frames: Mapping[Any, Any], wrench: FloatArray) -> Path:
    """Wrench on ``/ft`` and one message of transforms a row; one rotation alone is of a static transform."""
    from rosbags.rosbag2 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    types, kinds = store.types, ("tf2_msgs/msg/TFMessage", "geometry_msgs/msg/WrenchStamped")

    def made(kind: str, *values: Any) -> Any:
        return types[f"geometry_msgs/msg/{kind}"](*(float(v) if isinstance(v, float) else v for v in values))

    def header(row: int, frame: str) -> Any:
        seconds, part = divmod(START_NS + round(time_s[row] * 1e9), 10**9)
        return types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](seconds, part), frame)

    def transforms(row: int, pairs: list[Any]) -> Any:
        found = []
        for parent, child in pairs:
            place, turn = frames[parent, child]
            q = turn.as_quat() if turn.single else turn[row].as_quat()
            pose = made("Transform", made("Vector3", *place[row]), made("Quaternion", *q))
            found.append(made("TransformStamped", header(row, parent), child, pose))
        return types[kinds[0]](found)

    moving = [pair for pair, (_, turn) in frames.items() if not turn.single]
    with Writer(path, version=9) as writer:
        topics = {"/tf_static": kinds[0], "/tf": kinds[0], "/ft": kinds[1]}
        links = {topic: writer.add_connection(topic, kind, typestore=store) for topic, kind in topics.items()}
        for row in range(time_s.size):
            push, twist = (made("Vector3", *part) for part in (wrench[row, :3], wrench[row, 3:]))
            messages = {"/tf": transforms(row, moving)}
            messages["/ft"] = made("WrenchStamped", header(row, "tool0"), made("Wrench", push, twist))
            if row == 0:
                messages["/tf_static"] = transforms(0, [pair for pair in frames if pair not in moving])
            for topic, message in messages.items():
                at_ns = START_NS + round(time_s[row] * 1e9)
                writer.write(links[topic], at_ns, store.serialize_cdr(message, topics[topic]))
    return path


# ------------------------------------------------------------------ large files


def npz_bomb(path: Path, n_bytes: int) -> None:
    """Archive of a few kilobytes whose one array is ``n_bytes`` of zeros."""
    import zipfile

    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("a.npy", "w", force_zip64=True) as member,
    ):
        np.lib.format.write_array_header_1_0(  # type: ignore[no-untyped-call]
            member, {"descr": "<f8", "fortran_order": False, "shape": (n_bytes // 8,)}
        )
        for _ in range(n_bytes >> 20):
            member.write(bytes(1 << 20))
