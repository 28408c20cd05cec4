"""What is known about ROS 2 without an installation: definitions, their hashes, the program of the node, options."""

from __future__ import annotations

import ast
import sys
from pathlib import Path

import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from mindstage.errors import Ros2Error
from mindstage.msgs import message_types
from mindstage.msgs.message_registry import field_layout, interface_text, is_ros1_only
from mindstage.ros2.environment import Ros2Environment, find_environment
from mindstage.ros2.message_packages import USED_PACKAGES, build_message_packages, package_folders
from tests.conftest import ROOT

DIFFERENT = ("builtin_interfaces/msg/Duration", "diagnostic_msgs/msg/DiagnosticStatus")
"""A duration of ROS 1 may have negative nanoseconds; the level of a status is a number here, and a byte in ROS 2."""
PROGRAM = ROOT / "src" / "mindstage" / "ros2" / "node_process.py"


def test_the_program_of_the_node_imports_only_the_standard_library_numpy_and_rclpy() -> None:
    tree = ast.parse(PROGRAM.read_text(encoding="utf-8"), feature_version=(3, 10))
    imported = {
        name.partition(".")[0]
        for node in ast.walk(tree)
        for name in (
            [alias.name for alias in node.names]
            if isinstance(node, ast.Import)
            else [node.module or ""]
            if isinstance(node, ast.ImportFrom)
            else []
        )
    }
    assert imported - sys.stdlib_module_names == {"numpy", "rclpy", "rcl_interfaces"}


def test_the_fields_of_upstream_messages_have_the_hashes_of_jazzy() -> None:
    """The hash of ROS 2 (RIHS01) of each message that rosbags knows, computed from our text and from its own."""
    upstream = get_typestore(Stores.ROS2_JAZZY)
    ours = get_typestore(Stores.EMPTY)
    for name, cls in message_types().items():
        if "[" not in cls.__name__ and not is_ros1_only(name):
            package, _, short = name.partition("/")
            for type, fields in get_types_from_msg(interface_text(cls), f"{package}/msg/{short}").items():
                ours.fielddefs[type] = fields
    for name in DIFFERENT:  # both packages are part of every ROS 2, whose own types are used
        assert ours.hash_rihs01(name) != upstream.hash_rihs01(name)
        ours.fielddefs[name] = upstream.fielddefs[name]
    common = [name for name in ours.fielddefs if name in upstream.fielddefs]
    assert len(common) > 40
    assert {name: ours.hash_rihs01(name) for name in common} == {name: upstream.hash_rihs01(name) for name in common}


def test_layouts_name_types_as_rclpy_does() -> None:
    markers = field_layout(message_types()["tf2_msgs/TFMessage"])
    assert [each[:2] for each in markers] == [("transforms", "sequence<geometry_msgs/TransformStamped>")]
    header = dict(each[:2] for each in markers[0][2])
    assert header == {
        "header": "std_msgs/Header",
        "child_frame_id": "string",
        "transform": "geometry_msgs/Transform",
    }


def installation(folder: Path, *packages: str) -> Ros2Environment:
    for name in packages:
        (folder / "share" / name).mkdir(parents=True)
        (folder / "share" / name / "package.xml").write_text("<package/>")
    environment = Ros2Environment(Path(sys.executable), (folder,), "jazzy")
    environment.__dict__["facts"] = {"python": "3.11.2"}  # else rclpy would be imported
    return environment


def test_what_is_installed_is_not_built(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MINDSTAGE_CACHE", str(tmp_path / "cache"))
    some = installation(tmp_path / "some", "tf2_msgs", "control_msgs")
    assert set(package_folders(some)) == set(USED_PACKAGES) - {"tf2_msgs", "control_msgs"}
    every = installation(tmp_path / "every", *USED_PACKAGES)
    assert build_message_packages(every) == {}
    assert not list((tmp_path / "cache").rglob("package.xml"))


def test_a_package_that_cannot_be_built_says_what_cmake_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MINDSTAGE_CACHE", str(tmp_path / "cache"))
    nothing = installation(tmp_path / "nothing", "rclpy")
    with pytest.raises(Ros2Error, match=r"tf2_msgs cannot be built|has to be in PATH"):
        build_message_packages(nothing)
    assert not list((tmp_path / "cache").rglob("package.xml"))


def test_a_python_without_rclpy_is_refused_with_the_remedy(tmp_path: Path) -> None:
    with pytest.raises(Ros2Error, match=r"has no rclpy; source /opt/ros"):
        find_environment(tmp_path / "python3")
