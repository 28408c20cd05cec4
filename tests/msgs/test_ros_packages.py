"""The ROS packages in `ros/`, built with genpy (ROS 1) and with rosidl and a C compiler (ROS 2)."""

from __future__ import annotations

import importlib.util
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from xml.etree import ElementTree

import pytest

from mindstage.msgs import (
    RosVersion,
    mindstage_msgs,
    modul_spawner_msgs,
    simulation_interfaces,
    unreal_vis_msgs,
    world_control_msgs,
)
from mindstage.msgs.schema.base import Action, Message, Service, fields_of, struct_of
from tests.conftest import ROOT, missing

ROS_PYTHON = "/usr/bin/python3"
GENPY = Path("/usr/lib/genpy")
GENACTION = Path("/usr/lib/actionlib_msgs/genaction.py")
SHIPPED = {path.name: path for path in sorted((ROOT / "ros").glob("*")) + sorted((ROOT / "ros" / "ros1").glob("*"))}
SHIPPED = {name: path for name, path in SHIPPED.items() if (path / "package.xml").is_file()}
BOTH = ("mindstage_msgs", "modul_spawner_msgs", "unreal_vis_msgs", "world_control_msgs")
MODULES = (mindstage_msgs, modul_spawner_msgs, simulation_interfaces, unreal_vis_msgs, world_control_msgs)
FIELD = re.compile(r"(?P<type>[\w/]+)(?P<array>\[\d*\])? (?P<name>\w+)")


@pytest.fixture(scope="module")
def generator() -> ModuleType:
    """`scripts/make_ros_packages.py` as a module."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(ROOT / "scripts"))
        path = ROOT / "scripts" / "make_ros_packages.py"
        spec = importlib.util.spec_from_file_location("make_ros_packages", path)
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        patch.setitem(sys.modules, "make_ros_packages", module)
        spec.loader.exec_module(module)
        return module


def test_the_packages_are_those_of_the_definitions() -> None:
    command = [sys.executable, str(ROOT / "scripts" / "make_ros_packages.py"), "--check"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_files_have_the_fields_of_the_python_classes() -> None:
    # Read by this test's own few lines, not by the generator.
    for module in MODULES:
        package = module.__name__.rpartition(".")[2]
        for name in module.__all__:
            cls = getattr(module, name)
            if not isinstance(cls, type) or not issubclass(cls, Message | Service | Action):
                continue
            kind = "msg" if issubclass(cls, Message) else "srv" if issubclass(cls, Service) else "action"
            parts = {"msg": [""], "srv": ["Request", "Response"], "action": ["Goal", "Result", "Feedback"]}[kind]
            if cls is simulation_interfaces.SpawnEntity:  # catkin cannot build a service with the name of a message
                continue
            text = (SHIPPED[package] / kind / f"{getattr(cls, 'ros_name', '') or name}.{kind}").read_text()
            sections = re.split(r"^---$", text, flags=re.MULTILINE)
            assert len(sections) == len(parts)
            for part, section in zip(parts, sections, strict=True):
                message = getattr(cls, part) if part else cls
                lines = [line.partition("#")[0].strip() for line in section.splitlines()]
                written = [found["name"] for line in lines if (found := FIELD.fullmatch(line))]
                struct = struct_of(message)
                fields = [each.name for each in fields_of(message)]
                here = [each for each in fields if struct.only_in.get(each, RosVersion.ONE) is RosVersion.ONE]
                assert written == [struct.ros1_names.get(each, each) for each in here], (package, name, part)


@pytest.mark.parametrize(("version", "others"), [("1", "2"), ("2", "1")])
def test_the_manifests_name_what_each_version_of_ros_needs(version: str, others: str) -> None:
    for name, folder in SHIPPED.items():
        root = ElementTree.parse(folder / "package.xml").getroot()
        assert (root.tag, root.get("format"), root.findtext("name")) == ("package", "3", name)
        assert re.fullmatch(r"\d+\.\d+\.\d+", root.findtext("version") or "")
        condition = f"$ROS_VERSION == {others}"
        parts = [each for each in root.iter() if each.get("condition") != condition]
        needed = {each.text for each in parts if each.tag.endswith("depend")}
        built = [each.text for each in parts if each.tag == "build_type"]
        files = (path for path in folder.rglob("*.*") if path.suffix in {".msg", ".srv", ".action"})
        text = "".join(path.read_text() for path in files if version == "2" or "ros2" not in path.parts)
        types = set(re.findall(r"^([a-z]\w+)/[A-Z]", text, re.MULTILINE))
        if version == "1":
            assert built == ["catkin"]
            assert types | {"catkin", "message_generation", "message_runtime"} <= needed
            assert ("actionlib_msgs" in needed) == (folder / "action").is_dir()
        elif name in BOTH:
            assert built == ["ament_cmake"]
            assert types | {"rosidl_default_generators", "rosidl_default_runtime"} <= needed
            assert {each.text for each in parts if each.tag == "member_of_group"} == {"rosidl_interface_packages"}
        else:
            assert not built
            assert (folder.parent / "COLCON_IGNORE").is_file()  # ROS 2 has this package


def test_the_cmake_files_name_every_interface() -> None:
    for folder in SHIPPED.values():
        files = {path.name for kind in ("msg", "srv", "action") for path in folder.glob(f"{kind}/*")}
        stems = [Path(name).stem for name in files]
        assert sorted(stems) == sorted(set(stems))  # catkin makes a target of each
        text = (folder / "CMakeLists.txt").read_text()
        ros1, _, ros2 = text.partition("else()")
        named = re.compile(r"\b[A-Z]\w+\.(?:msg|srv|action)\b")
        assert sorted(named.findall(ros1)) == sorted(files)
        if ros2:
            paths = re.findall(r'"(?:\$\{CMAKE_CURRENT_SOURCE_DIR\}/(ros2):)?(\w+/\w+\.\w+)"', ros2)
            assert {Path(path).name for _, path in paths} == files
            assert all((folder / base / path).is_file() for base, path in paths)
            assert {path for base, path in paths if base} == {
                str(path.relative_to(folder / "ros2")) for path in (folder / "ros2").rglob("*.*")
            }


def test_a_name_that_ros_2_does_not_accept_needs_an_alias(generator: ModuleType, tmp_path: Path) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(generator, "ROOT", tmp_path)
        path = tmp_path / "M.msg"
        path.write_text("# Doc.\n\nstring Name\nuint64 steps 1  # at least one\nbuiltin_interfaces/Time stamp\n")
        with pytest.raises(generator.DefinitionError, match=r"M\.msg: ROS 2 does not accept the name Name"):
            generator.interface_text(path, ros=2)
        path.write_text(path.read_text().replace("string Name", "string Name  # @alias name"))
        lines = [generator.interface_text(path, ros=version).splitlines()[3:] for version in (1, 2)]
    assert lines == [
        ["string Name", "uint64 steps  # at least one", "time stamp"],
        ["string name", "uint64 steps 1  # at least one", "builtin_interfaces/Time stamp"],
    ]


# -- ROS 1 -------------------------------------------------------------------------------------------------------------

READ_MESSAGES = """
import importlib, json, sys
found = {}
for name in sys.argv[1:]:
    for kind in ("msg", "srv"):
        try:
            module = importlib.import_module(name + "." + kind)
        except ModuleNotFoundError as error:
            if error.name != name + "." + kind:
                raise
            continue
        for cls in vars(module).values():
            if isinstance(cls, type) and hasattr(cls, "_request_class"):
                found[cls._type] = [cls._md5sum]
            elif isinstance(cls, type) and hasattr(cls, "_md5sum"):
                found[cls._type] = [cls._md5sum, list(cls.__slots__), list(cls._slot_types)]
                cls()  # the fields of a new message are those of the messages that it contains
print(json.dumps(found))
"""


def build_ros1_packages(names: list[str], generated: Path, sources: Path) -> None:
    """Builds packages of `ros/` with genpy, as catkin does, and copies their sources to where ROS looks for them."""
    for name in names:
        source = sources / name
        shutil.copytree(SHIPPED[name], source, dirs_exist_ok=True)
        for action in sorted(source.glob("action/*.action")):
            _run(ROS_PYTHON, GENACTION, action, "-o", source / "msg")
    for name in names:
        source, target = sources / name, generated / name
        target.mkdir(parents=True, exist_ok=True)
        (target / "__init__.py").touch()
        includes = [f"-I{each}:/usr/share/{each}/msg" for each in ("std_msgs", "geometry_msgs", "actionlib_msgs")]
        includes += [f"-I{each}:{sources / each}/msg" for each in SHIPPED]
        for kind in ("msg", "srv"):
            files = sorted(source.glob(f"{kind}/*.{kind}"))
            if files:
                (target / kind).mkdir(exist_ok=True)
                _run(ROS_PYTHON, GENPY / f"gen{kind}_py.py", "-p", name, "-o", target / kind, *includes, *files)
                _run(ROS_PYTHON, GENPY / "genmsg_py.py", "--initpy", "-p", name, "-o", target / kind)


def _run(*command: str | Path) -> None:
    done = subprocess.run([str(each) for each in command], capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{command[1]} failed: {done.stdout}\n{done.stderr}"


def test_genpy_builds_the_packages_for_ros_1(tmp_path: Path) -> None:
    if not (GENPY / "genmsg_py.py").is_file() or not GENACTION.is_file():
        missing("genpy is not installed (Debian's packages python3-genpy, libactionlib-msgs-dev, ros-*-msgs)")
    build_ros1_packages(list(SHIPPED), tmp_path / "generated", tmp_path / "src")
    done = subprocess.run(
        [ROS_PYTHON, "-c", READ_MESSAGES, *SHIPPED],
        env={"PYTHONPATH": f"{tmp_path}/generated:/usr/lib/python3/dist-packages", "PATH": "/usr/bin:/bin"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    built = json.loads(done.stdout)
    assert built["mindstage_msgs/AskRequest"][1:] == [["question", "args"], ["string", "string"]]
    assert built["mindstage_msgs/SimulateActionGoal"][1] == ["header", "goal_id", "goal"]
    assert built["simulation_interfaces/StepSimulationRequest"][1:] == [["steps"], ["uint64"]]
    assert built["world_control_msgs/MoveObjectRequest"][1] == ["Name", "pose"]
    services = {each for each in built if each.startswith("mindstage_msgs/") and each.endswith("Request")}
    assert len(services) == len(list((SHIPPED["mindstage_msgs"] / "srv").glob("*.srv")))
    # Checksums of the original definitions (genmsg's algorithm); with others, programs cannot talk to each other.
    assert {name: built[name][0] for name in ORIGINAL_CHECKSUMS} == ORIGINAL_CHECKSUMS


ORIGINAL_CHECKSUMS = {
    "world_control_msgs/AttachModelToParent": "0ac729b29ea5c11248acb7a07c82bf69",
    "world_control_msgs/Checkpoint": "f70ae637da084b563489c9fbdaabffdf",
    "world_control_msgs/DeleteAll": "b853d82cbb7e3edf710fffde6b818598",
    "world_control_msgs/DeleteModel": "4dc5c1ae2e494627977ff6a6eeb914ca",
    "world_control_msgs/GetModelPose": "0e4c6217f4ce56b5edfefb7de822b3db",
    "world_control_msgs/GetModelSocketPose": "c4aa69035f29eefd026c81aa84d8731a",
    "world_control_msgs/HighlightModel": "6f706cc6a73e37840bc57fe10b6409a8",
    "world_control_msgs/MoveObject": "1916c9cdfc2a8ac0feb27b842aa62b28",
    "world_control_msgs/ObjectToObjectState": "ff88f931ed2b576ac48b17fd019ab5ea",
    "world_control_msgs/ResetLevel": "4dc5c1ae2e494627977ff6a6eeb914ca",
    "world_control_msgs/SetMaterial": "da2cffcc9068ba1005c885f71ac04793",
    "world_control_msgs/SetModelPose": "b57fafcf048225a1fa518d97c0637ef1",
    "world_control_msgs/SetPhysicsProperties": "ba340c9a3ba04d9ca3c91a63dace14af",
    "world_control_msgs/SpawnModel": "7adc95cda006aad757d09f7115dbe1e8",
    "world_control_msgs/SpawnPhysicsConstraint": "16f9aca2cfa1dc9fdb191d0ea368e0f1",
    "world_control_msgs/SpawnProMesh": "57343439ea7c63591c79e80288faece5",
    "world_control_msgs/SpawnSemanticMap": "b6f27094aadd2a5fb431f929b975875f",
    "unreal_vis_msgs/DisplayBasicMarker": "c417c427dc7311e67be39e437306e094",
    "unreal_vis_msgs/DisplayTrajectory": "14965543b92b0e4746f85630b1667718",
    "unreal_vis_msgs/RemoveMarker": "33c8bee76e203f8d7d63c7c5cd103d9a",
    "modul_spawner_msgs/SpawnRobot": "73f1cca15899cad219165c0771c4ab26",
}
"""Of URoboSim's packages, each with everything that the messages contain."""

# -- ROS 2 -------------------------------------------------------------------------------------------------------------

CONTAINED = {
    "builtin_interfaces": ("Time", "Duration"),
    "std_msgs": ("ColorRGBA", "Header"),
    "geometry_msgs": ("Point", "Pose", "Quaternion", "Vector3"),
}
"""What the messages contain; Debian has no ROS 2 packages of these, so they are generated as well."""


def test_rosidl_builds_the_packages_for_ros_2(generator: ModuleType, tmp_path: Path) -> None:
    if shutil.which("rosidl") is None or not Path("/usr/include/rosidl_runtime_c").is_dir():
        missing("rosidl is not installed (Debian's packages rosidl-tools, rosidl-generator-c-cpp, python3-ament-index)")
    if shutil.which("gcc") is None:
        missing("gcc is not installed (Debian's packages gcc and libc6-dev)")
    paths: dict[str, list[str]] = {}
    for package, names in CONTAINED.items():
        (tmp_path / package / "msg").mkdir(parents=True)
        for name in names:
            text = generator.interface_text(generator.DEFINITIONS / package / "msg" / f"{name}.msg", ros=2)
            (tmp_path / package / "msg" / f"{name}.msg").write_text(text)
            paths.setdefault(package, []).append(f"{tmp_path / package}:msg/{name}.msg")
    (tmp_path / "unique_identifier_msgs" / "msg").mkdir(parents=True)
    (tmp_path / "unique_identifier_msgs" / "msg" / "UUID.msg").write_text("uint8[16] uuid\n")
    paths["unique_identifier_msgs"] = [f"{tmp_path / 'unique_identifier_msgs'}:msg/UUID.msg"]  # in every action
    for name in BOTH:
        cmake = (SHIPPED[name] / "CMakeLists.txt").read_text().partition("else()")[2]
        for base, path in re.findall(r'"(?:\$\{CMAKE_CURRENT_SOURCE_DIR\}/(ros2):)?(\w+/\w+\.\w+)"', cmake):
            paths.setdefault(name, []).append(f"{SHIPPED[name] / base}:{path}")
    output = tmp_path / "out"
    running = {
        package: subprocess.Popen(
            ["rosidl", "generate", "-t", "c", "-o", str(output / package), package, *files],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        for package, files in paths.items()
    }
    for package, process in running.items():
        text, _ = process.communicate(timeout=240.0)
        assert process.returncode == 0, (package, text)
    sources = sorted(str(path) for name in BOTH for path in (output / name).rglob("*.c"))
    assert len(sources) == sum(len(paths[name]) for name in BOTH)
    includes = [f"-I{path}" for path in Path("/usr/include").glob("r*") if path.name.startswith(("rosidl_", "rcutils"))]
    done = subprocess.run(
        ["gcc", "-std=c11", "-Wall", "-fsyntax-only", f"-I{output}", *includes, *sources],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    header = (output / "world_control_msgs" / "srv" / "detail" / "move_object__struct.h").read_text()
    assert re.search(r"rosidl_runtime_c__String name;", header)  # `Name` is not a valid name in ROS 2
    ask = (output / "mindstage_msgs" / "srv" / "detail" / "ask__struct.h").read_text()
    assert "mindstage_msgs__msg__Refusal refusal;" in ask
