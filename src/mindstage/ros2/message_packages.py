"""Builds the ROS 2 message packages that Mindstage uses and that a ROS 2 installation lacks.

The definitions are those of `mindstage.msgs`. Only what rclpy needs is built: the C messages, their type supports for
introspection and Fast DDS, and the Python modules. An installed package is never built again: what is installed wins.

Nothing is written outside of the cache directory (or the given folder). A result is found again by its key, the hash of
all definitions, of this module, and of the versions of Python and of the installation.
"""

from __future__ import annotations

import hashlib
import re
import shutil
import subprocess
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from mindstage.errors import Ros2Error
from mindstage.msgs import RosVersion, action_types, message_types, service_types
from mindstage.msgs.message_registry import interface_text, is_ros1_only, packages_in
from mindstage.ros2.environment import Ros2Environment, cache_folder

__all__ = ["USED_PACKAGES", "build_message_packages", "package_folders"]

USED_PACKAGES = (
    "tf2_msgs",
    "control_msgs",
    "controller_manager_msgs",
    "nav2_msgs",
    "simulation_interfaces",
    "world_control_msgs",
    "unreal_vis_msgs",
    "modul_spawner_msgs",
    "mindstage_msgs",
)
"""Packages with types of services, topics and actions that are no part of ROS 2's common interfaces."""

_BUILD_TIME_S = 1200.0
"""Longest time in which one package is built [s]."""
_ROS2_NAMES = {"rosapi": "rosapi_msgs"}
"""Packages that have another name in ROS 2."""
_CMAKE = """cmake_minimum_required(VERSION 3.16)
project({package} C CXX)
find_package(ament_cmake REQUIRED)
find_package(rosidl_default_generators REQUIRED)
{dependencies}
# rclpy uses C; C++ messages take most of the time of a build.
list(FILTER AMENT_EXTENSIONS_rosidl_generate_idl_interfaces EXCLUDE REGEX "cpp")
rosidl_generate_interfaces(${{PROJECT_NAME}}
  {files}
  {needed})
# The description of each message has static names that others have, too.
get_target_property(_sources ${{PROJECT_NAME}}__rosidl_generator_c SOURCES)
list(FILTER _sources INCLUDE REGEX "__description[.]c$")
set_source_files_properties(${{_sources}} PROPERTIES SKIP_UNITY_BUILD_INCLUSION ON)
# Wheels name the include folders of the machine that built them.
get_property(_targets DIRECTORY PROPERTY IMPORTED_TARGETS)
foreach(_target IN LISTS _targets)
  get_target_property(_folders ${{_target}} INTERFACE_INCLUDE_DIRECTORIES)
  if(_folders)
    set(_existing "")
    foreach(_folder IN LISTS _folders)
      if(EXISTS "${{_folder}}" OR _folder MATCHES "^\\\\$<")
        list(APPEND _existing "${{_folder}}")
      endif()
    endforeach()
    set_target_properties(${{_target}} PROPERTIES INTERFACE_INCLUDE_DIRECTORIES "${{_existing}}")
  endif()
endforeach()
ament_package()
"""
_MANIFEST = """<?xml version="1.0"?>
<package format="3">
  <name>{package}</name>
  <version>0.0.0</version>
  <description>Interfaces that Mindstage uses.</description>
  <maintainer email="maintainers@users.noreply.github.com">The Mindstage maintainers</maintainer>
  <license>Apache-2.0</license>
  <buildtool_depend>ament_cmake</buildtool_depend>
  <buildtool_depend>rosidl_default_generators</buildtool_depend>
  <exec_depend>rosidl_default_runtime</exec_depend>
{depends}
  <member_of_group>rosidl_interface_packages</member_of_group>
  <export><build_type>ament_cmake</build_type></export>
</package>
"""


@dataclass(frozen=True)
class _Package:
    name: str
    files: dict[str, str]
    """Texts by path, such as `srv/Ask.srv`."""
    needed: tuple[str, ...]
    """Packages that its messages contain, and `action_msgs` if it has actions."""


def package_folders(environment: Ros2Environment, packages: Iterable[str] = USED_PACKAGES) -> dict[str, Path]:
    """Returns the folder in the cache directory of each package that the installation lacks, once it is built.

    They are in the order of their dependencies.
    """
    found: dict[str, Path] = {}
    for package in _packages(packages):
        if not environment.has_package(package.name):
            parts = (sorted(package.files.items()), package.needed, [found.get(each) for each in package.needed])
            key = hashlib.sha256(repr((parts, environment.identity, _CMAKE, _MANIFEST)).encode())
            found[package.name] = cache_folder() / "messages" / f"{package.name}-{key.hexdigest()[:16]}"
    return found


def build_message_packages(
    environment: Ros2Environment, folder: Path | None = None, *, packages: Iterable[str] = USED_PACKAGES
) -> dict[str, Path]:
    """Builds the packages that the installation lacks, except those that were built before.

    Args:
        environment: the installation of ROS 2, with cmake, a C and C++ compiler and ninja in PATH.
        folder: where to install them all; None for folders in the cache directory.
        packages: names as in `mindstage.msgs`.

    Returns:
        The folder of each package that the installation lacks, to be put in front of AMENT_PREFIX_PATH.

    Raises:
        Ros2Error: a program is missing, or a package cannot be built; the message has the end of the output.
    """
    names = tuple(packages)
    targets = package_folders(environment, names)
    if folder is not None:
        targets = dict.fromkeys(targets, folder)
    for package in _packages(names):
        target = targets.get(package.name)
        if target is None or (target / "share" / package.name / "package.xml").exists():
            continue
        for program in ("cmake", "ninja", "cc", "c++"):
            if shutil.which(program) is None:
                remedy = "on Debian: apt-get install cmake ninja-build g++ python3-dev"
                raise Ros2Error(f"to build message packages, {program} has to be in PATH", remedy=remedy)
        target.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix="mindstage-ros2-", dir=target.parent) as scratch:
            prefix = target if folder else Path(scratch, "install")
            needed = [targets[each] for each in package.needed if each in targets]
            _build(package, environment, Path(scratch), prefix, needed)
            if folder is None:
                with suppress(OSError):  # another process has built it meanwhile
                    prefix.rename(target)
    return targets


def _build(package: _Package, environment: Ros2Environment, scratch: Path, prefix: Path, needed: list[Path]) -> None:
    source = scratch / package.name
    for path, text in package.files.items():
        (source / path).parent.mkdir(parents=True, exist_ok=True)
        (source / path).write_text(text)
    (source / "CMakeLists.txt").write_text(
        _CMAKE.format(
            package=package.name,
            dependencies="\n".join(f"find_package({each} REQUIRED)" for each in package.needed),
            files="\n  ".join(f'"{path}"' for path in package.files),
            needed=f"DEPENDENCIES {' '.join(package.needed)}" if package.needed else "",
        )
    )
    depends = "\n".join(f"  <depend>{each}</depend>" for each in package.needed)
    (source / "package.xml").write_text(_MANIFEST.format(package=package.name, depends=depends))
    variables = environment.variables(prefix, *needed) | {"ROS_VERSION": "2"}
    build = source / "build"
    configure = [
        *("cmake", "-G", "Ninja", "-S", str(source), "-B", str(build), f"-DCMAKE_INSTALL_PREFIX={prefix}"),
        *(f"-DPython3_EXECUTABLE={environment.python}", "-DPython3_FIND_STRATEGY=LOCATION", "-DBUILD_TESTING=OFF"),
        *("-DCMAKE_BUILD_TYPE=None", "-DCMAKE_C_FLAGS=-O0", "-DCMAKE_CXX_FLAGS=-O0", "-DCMAKE_UNITY_BUILD=ON"),
        *(
            "-DCMAKE_UNITY_BUILD_BATCH_SIZE=0",
            f"-DCMAKE_PREFIX_PATH={variables['AMENT_PREFIX_PATH'].replace(':', ';')}",
        ),
    ]
    for command in (configure, ["ninja", "-C", str(build), "install"]):
        try:
            done = subprocess.run(
                command, env=variables, capture_output=True, text=True, timeout=_BUILD_TIME_S, check=False
            )
        except subprocess.TimeoutExpired:
            raise Ros2Error(f"building {package.name} took more than {_BUILD_TIME_S:g} s") from None
        if done.returncode:
            lines = (done.stdout + done.stderr).strip().splitlines()
            errors = [line for line in lines if "error" in line.lower()] or lines
            raise Ros2Error(
                "\n  ".join((f"{package.name} cannot be built:", *errors[:6], *lines[-6:])),
                remedy="the compiler's output is above",
            )


def _packages(names: Iterable[str]) -> Iterator[_Package]:
    """The packages in the order of their dependencies."""
    waiting = {name: _package(name) for name in names}
    while waiting:
        ready = [name for name, each in waiting.items() if not waiting.keys() & set(each.needed) - {name}]
        for name in ready:
            yield waiting.pop(name)


def _package(name: str) -> _Package:
    files: dict[str, str] = {}
    needed: set[str] = set()
    parts: tuple[tuple[str, dict[str, tuple[type, ...]]], ...] = (
        ("msg", {type: (cls,) for type, cls in message_types().items() if "[" not in cls.__name__}),
        ("srv", {type: tuple(each) for type, each in service_types().items()}),
        ("action", {type: tuple(each) for type, each in action_types().items()}),
    )
    for kind, types in parts:
        for type, classes in types.items():
            package, _, short = type.partition("/")
            if package != name or (kind == "msg" and is_ros1_only(type) and package not in _ROS2_NAMES):
                continue
            files[f"{kind}/{short}.{kind}"] = "---\n".join(interface_text(cls, ros=RosVersion.TWO) for cls in classes)
            needed.update(*(packages_in(cls, ros=RosVersion.TWO) for cls in classes))
            needed.update({"action_msgs"} if kind == "action" else ())
    own = _ROS2_NAMES.get(name, name)
    if own != name:
        files = {path: re.sub(rf"^{name}/", f"{own}/", text, flags=re.MULTILINE) for path, text in files.items()}
        # rosapi_msgs renamed this field, which is a keyword of C.
        files = {
            path: re.sub(r"^string default$", "string default_value", files[path], flags=re.MULTILINE) for path in files
        }
    return _Package(own, files, tuple(sorted(needed - {name})))
