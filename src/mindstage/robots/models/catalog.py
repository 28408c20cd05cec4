"""The models of robots that are known by name: the bundled one, and those in installed packages.

Packages are found by the metadata of their distributions, without being imported. An SRDF of our own says what the
description of a package leaves open: groups, end effectors, and positions in which the arms are folded.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

import msgspec

from mindstage.errors import RobotNotFoundError

__all__ = ["BUNDLED_FOLDER", "KnownModel", "ModelSource", "find_model", "list_models"]

BUNDLED_FOLDER = Path(__file__).resolve().parent.parent / "bundled"
"""The folder of the bundled models, and of SRDF files for models of other packages."""
_SUFFIXES = (".urdf", ".urdf.xacro", ".xacro", ".xml", ".mjcf")
_EXAMPLES = "cmeel.prefix/share/example-robot-data/robots"
_STRETCH = "stretch_urdf"
_ROBOSUITE = "robosuite_models/assets/robots"
_STRETCH_FINGERS = tuple((f"joint_gripper_finger_{side}", -0.6, 0.6) for side in ("left", "right"))
"""The calibration of each robot sets the range of its fingers: that of the description of Stretch 2 is assumed."""
_GYMNASIUM = "gymnasium_robotics/envs/assets"


class ModelSource(msgspec.Struct, frozen=True, kw_only=True):
    """The files of a model."""

    path: Path
    folder: Path | None = None
    """The folder of its package, whose files the description may name."""
    name: str | None = None
    """The name of the robot; None for that of the description."""
    srdf: Path | None = None
    mimics: tuple[tuple[str, str], ...] = ()
    """Joints that move with another one, which the description does not say: follower and master."""
    ranges: tuple[tuple[str, float, float], ...] = ()
    """Joints whose range the description leaves at 0 to 0, with the limits that are assumed [m or rad]."""


class KnownModel(msgspec.Struct, frozen=True, kw_only=True):
    """A model that is known by name."""

    name: str
    title: str
    package: str = ""
    """The distribution that has its files, as it is installed; empty for a bundled model."""
    file: str = ""
    """Its description, relative to where the package is installed."""
    srdf: str = ""
    """The name of an SRDF in `BUNDLED_FOLDER`."""
    mimics: tuple[tuple[str, str], ...] = ()
    ranges: tuple[tuple[str, float, float], ...] = ()

    @property
    def path(self) -> Path | None:
        """Its description; None if the package is not installed."""
        if not self.package:
            return BUNDLED_FOLDER / self.file
        try:
            path = Path(str(distribution(self.package).locate_file(self.file)))
        except PackageNotFoundError:
            return None
        return path if path.is_file() else None

    @property
    def is_installed(self) -> bool:
        """Whether its files exist."""
        return self.path is not None


def _stretch(name: str, title: str, file: str, *, ranges: tuple[tuple[str, float, float], ...] = ()) -> KnownModel:
    sections = tuple((f"joint_arm_l{number}", "joint_arm_l3") for number in (2, 1, 0))
    return KnownModel(
        name=name,
        title=title,
        package="hello-robot-stretch-urdf",
        file=f"{_STRETCH}/{file}",
        srdf="stretch.srdf",
        mimics=(*sections, ("joint_gripper_finger_right", "joint_gripper_finger_left")),
        ranges=ranges,
    )


def _example(name: str, title: str, file: str, srdf: str = "") -> KnownModel:
    return KnownModel(name=name, title=title, package="example-robot-data", file=f"{_EXAMPLES}/{file}", srdf=srdf)


def _robosuite(name: str, title: str, folder: str, srdf: str = "") -> KnownModel:
    return KnownModel(
        name=name, title=title, package="robosuite-models", file=f"{_ROBOSUITE}/{folder}/robot.xml", srdf=srdf
    )


_MODELS = (
    KnownModel(
        name="mobile_manipulator",
        title="bundled mobile manipulator: planar base, lift, arm of seven axes, parallel gripper, head",
        file="mobile_manipulator.urdf",
        srdf="mobile_manipulator.srdf",
    ),
    _stretch("stretch", "Hello Robot Stretch 2", "RE2V0/stretch_description_RE2V0_tool_stretch_dex_wrist.urdf"),
    _stretch(
        "stretch_se3",
        "Hello Robot Stretch 3",
        "SE3/stretch_description_SE3_eoa_wrist_dw3_tool_sg3.urdf",
        ranges=_STRETCH_FINGERS,
    ),
    _stretch("stretch_re1", "Hello Robot Stretch 1", "RE1V0/stretch_description_RE1V0_tool_stretch_dex_wrist.urdf"),
    _example("panda", "Franka Emika Panda", "panda_description/urdf/panda.urdf", "panda.srdf"),
    _example("pr2", "Willow Garage PR2", "pr2_description/urdf/pr2.urdf", "pr2.srdf"),
    _example("tiago", "PAL Robotics TIAGo with a hand", "tiago_description/robots/tiago.urdf", "tiago.srdf"),
    _example(
        "tiago_no_hand",
        "PAL Robotics TIAGo without a hand",
        "tiago_description/robots/tiago_no_hand.urdf",
        "tiago.srdf",
    ),
    _example("tiago_dual", "PAL Robotics TIAGo with two arms", "tiago_description/robots/tiago_dual.urdf"),
    _example("tiago_pro", "PAL Robotics TIAGo Pro", "tiago_pro_description/robots/tiago_pro.urdf"),
    _example("ur3", "Universal Robots UR3", "ur_description/urdf/ur3_robot.urdf", "ur.srdf"),
    _example("ur5", "Universal Robots UR5", "ur_description/urdf/ur5_robot.urdf", "ur.srdf"),
    _example("ur10", "Universal Robots UR10", "ur_description/urdf/ur10_robot.urdf", "ur.srdf"),
    _example("baxter", "Rethink Robotics Baxter", "baxter_description/urdf/baxter.urdf"),
    _example("kinova", "Kinova", "kinova_description/robots/kinova.urdf"),
    _example("xarm7", "UFACTORY xArm 7", "xarm_description/urdf/xarm7.urdf"),
    _example("talos", "PAL Robotics TALOS", "talos_data/robots/talos_full_v2.urdf"),
    _robosuite("pr2_mjcf", "Willow Garage PR2, as MJCF", "pr2", "pr2.srdf"),
    _robosuite("yumi", "ABB YuMi, as MJCF", "yumi"),
    KnownModel(
        name="fetch",
        title="Fetch Robotics Fetch, as MJCF",
        package="gymnasium-robotics",
        file=f"{_GYMNASIUM}/fetch/reach.xml",
        srdf="fetch.srdf",
    ),
)


def list_models() -> Sequence[KnownModel]:
    """The models that are known by name, installed or not."""
    return _MODELS


def find_model(name: str, *, folders: Iterable[Path] = ()) -> ModelSource:
    """Finds the files of a model.

    Args:
        name: a name of `list_models`, the path of a description, or the name of a description in one of the folders.
        folders: searched for `NAME.urdf`, `NAME.urdf.xacro`, `NAME.xml` and the like, at most two levels deep.

    Raises:
        RobotNotFoundError: there is none; it says which package has to be installed if the name is known.
    """
    known = next((model for model in _MODELS if model.name == name), None)
    if known is not None:
        path = known.path
        if path is None:
            raise RobotNotFoundError(name, remedy=f"its files are in a package: pip install {known.package}")
        srdf = BUNDLED_FOLDER / known.srdf if known.srdf else None
        folder = path.parents[known.file.count("/") - 1] if known.package else None
        return ModelSource(
            path=path, folder=folder, name=known.name, srdf=srdf, mimics=known.mimics, ranges=known.ranges
        )
    if Path(name).is_file():
        return ModelSource(path=Path(name))
    for folder in folders:
        for pattern in (name, *(f"{name}{suffix}" for suffix in _SUFFIXES)):
            for level in ("", "*/", "*/*/"):
                found = next((each for each in sorted(folder.glob(f"{level}{pattern}")) if each.is_file()), None)
                if found is not None:
                    return ModelSource(path=found)
    raise RobotNotFoundError(name, remedy=_remedy(name))


def _remedy(name: str) -> str:
    if "/" in name or name.endswith(_SUFFIXES):
        return "the file does not exist"
    names = [model.name for model in _MODELS]
    near = get_close_matches(name, names, n=3)
    return f"near: {', '.join(near)}" if near else f"known are {', '.join(names)}, or the path of a description"
