"""Reading of robot descriptions to a `RobotModel`: URDF, xacro and MJCF, with SRDF beside them."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from functools import cache, partial
from hashlib import blake2b
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import msgspec
import numpy as np
from msgspec.structs import replace

from mindstage.engines.mujoco.mujoco_kinematics import touching_shares
from mindstage.errors import RobotModelError, SourceParseError
from mindstage.files import cache_dir, cached_content, modules_of
from mindstage.maps.io.ros_packages import RosPackagePath
from mindstage.maps.io.xml import first_tag
from mindstage.maps.urdf.parse import read_urdf
from mindstage.maps.urdf.urdf_model import UrdfInertial, UrdfJoint, UrdfJointType, UrdfRobot
from mindstage.maps.urdf.xacro_process import XacroRequest, requested_arguments
from mindstage.robots.models.catalog import ModelSource, find_model
from mindstage.robots.models.forward_kinematics import rest_positions
from mindstage.robots.models.link_geometry import read_link_geometries
from mindstage.robots.models.link_tree import LinkTree, sorted_tree
from mindstage.robots.models.mjcf import read_mjcf_robot
from mindstage.robots.models.robot_model import (
    BaseType,
    Gripper,
    GripperType,
    ModelNote,
    RobotJoint,
    RobotJointType,
    RobotLink,
    RobotMimic,
    RobotModel,
    RobotSensor,
)
from mindstage.robots.models.sensor_elements import read_gazebo_sensors
from mindstage.robots.models.srdf import Srdf, read_srdf
from mindstage.robots.models.structure import (
    base_type,
    find_structure,
    is_named_as_finger,
    wheel_joints,
    without_base_joints,
)
from mindstage.scene import BodyGeometry, Vector
from mindstage.scene.geometry import Inertia
from mindstage.scene.transforms import normalized_pose_array, rotation_matrix

__all__ = ["load_model"]

_JOINT_TYPES = {
    UrdfJointType.FIXED: RobotJointType.FIXED,
    UrdfJointType.REVOLUTE: RobotJointType.REVOLUTE,
    UrdfJointType.CONTINUOUS: RobotJointType.CONTINUOUS,
    UrdfJointType.PRISMATIC: RobotJointType.PRISMATIC,
}
_PACKAGE_NAME = re.compile(r"package://([^/\"'<>\s]+)|\$\(find\s+([^)\s]+)\)")
_HEAD_BYTES = 64 * 1024
_MIN_INERTIA = 1e-9
"""[kg m²]."""
_MIN_GYRATION_M = 1e-3
"""Least radius of gyration of a link; some descriptions have moments of 0."""
_MOMENT_TOLERANCE = 1e-3
"""By which fraction a principal moment may exceed the sum of the others."""
_STATES, _SEED = 150, 1
"""Number of random states, and what they begin from."""
_ALWAYS = 0.9
"""The part of the states from which on a pair always touches; about that of MoveIt's setup assistant."""
_OFTEN = 0.1
"""The part from which on a pair that is near in the tree is looked at: dividing a mesh takes seconds."""
_NEAR_JOINTS = 2
"""Number of joints between two links that are near in the tree."""
_CLOSING_STATES = 9
"""Number of states of a gripper, from open to closed."""
_MAX_DRIVES = 2
"""Number of drives above which a gripper is a hand, whose fingers touch each other with all of their links."""
_MAX_STORED_BYTES = 16 << 20
"""Total size of what was found about links that touch, from which the least recently used files are deleted."""
_MAX_POSITION = 1e4
"""Limits beyond this are none [m or rad]: descriptions write 1e16 for a joint that turns freely."""


def load_model(
    source: str | Path,
    *,
    name: str | None = None,
    srdf: Path | None = None,
    folders: Iterable[Path] = (),
    xacro: XacroRequest = None,
    divide: bool = False,
    cache: Path | None = None,
) -> RobotModel:
    """Reads a robot description.

    Args:
        source: the path of a URDF, xacro or MJCF file, or a name of `list_models`, such as "mobile_manipulator".
        name: the name of the robot; by default that in the description.
        srdf: its SRDF; by default one of the same name beside the description, or in a folder `srdf` near it.
        folders: where `package://` meshes are searched, and where files that an MJCF file names may be, besides its
            own folder.
        xacro: whether the description is expanded if it contains xacro; by default if its name ends in `.xacro`. A
            mapping gives the values of its arguments (`xacro:arg`), and asks for it too. Give False for a source that
            the user has not chosen.
        divide: whether the collision meshes of links near each other whose hulls touch in many states are divided into
            convex parts, without an SRDF that states which pairs do not collide. The first time this takes some seconds
            for each. By default the shape of a mesh is its hull.
        cache: directory for imported meshes; by default in the user's cache.

    Raises:
        RobotNotFoundError: no model has that name.
        RobotModelError: the description cannot be read.
    """
    folders = tuple(folders)
    found = ModelSource(path=source) if isinstance(source, Path) else find_model(source, folders=folders)
    path, name = found.path, name or found.name
    is_mjcf = _is_mjcf(path)
    if is_mjcf:
        description = _from_mjcf(path, found, folders)
    else:
        description = _from_urdf(path, found, folders, cache, xacro=requested_arguments(path, xacro))
    stated = srdf or found.srdf
    used = stated or _srdf_beside(path)
    if used is not None and stated is None:
        note = ModelNote(subject="", text=f"{used.name} is its SRDF, by its name")
        description = replace(description, notes=(*description.notes, note))
    if not divide:
        description = replace(description, divided=None)
    return _assemble(description, Srdf() if used is None else read_srdf(used), path, name)


class _Description(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """What a URDF or MJCF file says about a robot."""

    name: str
    links: Sequence[RobotLink]
    joints: Sequence[RobotJoint]
    notes: Sequence[ModelNote]
    states: tuple[tuple[str, str, tuple[tuple[str, float], ...]], ...] = ()
    disabled_collisions: frozenset[tuple[str, str]] = frozenset()
    sensors: tuple[RobotSensor, ...] = ()
    """Those that an MJCF file states."""
    urdf: str = ""
    divided: Callable[[Collection[str]], Mapping[str, BodyGeometry]] | None = None
    """The geometry of all links, in which the collision meshes of some are divided; None if they stay as they are."""


def _is_mjcf(path: Path) -> bool:
    """Whether the root element of a file is <mujoco>."""
    try:
        with path.open("rb") as file:
            tag = first_tag(re.sub(rb"<!--.*?-->", b"", file.read(_HEAD_BYTES), flags=re.DOTALL))
    except OSError as error:
        remedy = "give the path of a URDF, xacro or MJCF file"
        raise RobotModelError(str(path), cause=error.strerror or str(error), remedy=remedy) from error
    return tag is not None and tag[1] == b"mujoco"


def _from_mjcf(path: Path, source: ModelSource, folders: Sequence[Path]) -> _Description:
    robot = read_mjcf_robot(path, folders=folders if source.folder is None else (*folders, source.folder))
    joints, notes = _with_mimics(robot.joints, source.mimics)
    return _Description(
        name=robot.name,
        links=robot.links,
        joints=joints,
        notes=(*robot.notes, *notes),
        states=robot.states,
        disabled_collisions=robot.disabled_collisions,
        sensors=robot.sensors,
    )


def _from_urdf(
    path: Path, source: ModelSource, folders: Sequence[Path], cache: Path | None, *, xacro: Mapping[str, str] | None
) -> _Description:
    packages = RosPackagePath((*folders, *_package_folders(path)))
    try:
        urdf = read_urdf(path, packages, xacro=xacro, measure_meshes=False)
    except SourceParseError as error:
        remedy = "give a URDF, xacro or MJCF file"
        raise RobotModelError(error.place, cause=error.cause, remedy=remedy) from error
    notes = [
        ModelNote(subject=issue.subject, text=f"{issue.problem}: {issue.action}", is_guess=not issue.is_missing)
        for issue in urdf.issues
    ]
    hands = {each.name for each in urdf.links if is_named_as_finger(each.name)}
    hands |= {each.child for each in urdf.joints if is_named_as_finger(each.name)}
    read = partial(read_link_geometries, urdf, path, packages, touching=hands, cache=cache)
    geometries, geometry_notes = read()
    links = []
    for link in urdf.links:
        inertia, change = (None, "") if link.inertial is None else _inertia(link.inertial)
        links.append(RobotLink(name=link.name, geometry=geometries.get(link.name), inertia=inertia))
        if change:
            notes.append(ModelNote(subject=link.name, text=change))
    joints, joint_notes = _joints(urdf, {name: (lower, upper) for name, lower, upper in source.ranges})
    joints, coupling_notes = _with_couplings(joints, _couplings(urdf))
    joints, mimic_notes = _with_mimics(joints, source.mimics)
    return _Description(
        name=urdf.name,
        links=links,
        joints=joints,
        notes=(*notes, *geometry_notes, *joint_notes, *coupling_notes, *mimic_notes),
        urdf=urdf.source_xml,
        divided=lambda links: read(divided=links)[0],
    )


def _assemble(description: _Description, srdf: Srdf, path: Path, name: str | None) -> RobotModel:
    """The model of a description: the tree in order, without the joints of wheels, and its parts."""
    links, joints, tree_notes = sorted_tree(description.links, description.joints)
    base_notes: list[ModelNote] = []
    links, joints, is_moved = without_base_joints(links, joints, base_notes)
    base = BaseType.PLANAR if is_moved else base_type(joints, srdf, base_notes)
    if base is not BaseType.FIXED and (wheels := wheel_joints(joints)):
        text = "it is fixed, as the wheels and casters of the base are: the base is moved as a whole"
        base_notes += (ModelNote(subject=joint.name, text=text) for joint in wheels)
        fixed = {joint.name for joint in wheels}
        joints = tuple(_fixed(joint) if joint.name in fixed else joint for joint in joints)
    states = (*srdf.states, *description.states)
    tree = LinkTree(links, joints)
    stated = srdf.disabled_collisions | description.disabled_collisions
    disabled = {pair for pair in stated | tree.neighbors() if tree.links.keys() >= set(pair)}
    structure = find_structure(tree, replace(srdf, states=states), base=base)
    contact_notes: list[ModelNote] = []
    sensor_notes: list[ModelNote] = []
    stated_sensors = (*description.sensors, *read_gazebo_sensors(description.urdf, sensor_notes))
    lost = [each for each in stated_sensors if each.link not in tree.links]
    sensor_notes += (
        ModelNote(subject=each.link, text=f"{each.name} is left out: there is no such link", is_guess=False)
        for each in lost
    )
    for gripper in structure.grippers:
        disabled |= _contacts_on_closing(tree, gripper, disabled, contact_notes)
    if structure.arms and not srdf.disabled_collisions:
        links, always = _self_contacts(description, links, joints, disabled, contact_notes)
        disabled |= always
    return RobotModel(
        name=name or description.name,
        links=links,
        joints=joints,
        base=structure.base,
        arms=structure.arms,
        grippers=structure.grippers,
        head=structure.head,
        sensors=_all_sensors([each for each in stated_sensors if each not in lost], structure.sensors),
        group_states=states,
        disabled_collisions=frozenset(disabled),
        home_positions=structure.home_positions,
        source=str(path),
        urdf=description.urdf,
        notes=(*description.notes, *tree_notes, *base_notes, *structure.notes, *sensor_notes, *contact_notes),
    )


def _all_sensors(stated: Sequence[RobotSensor], named: Sequence[RobotSensor]) -> tuple[RobotSensor, ...]:
    """The stated sensors, and those found by the names of links that have none of the type."""
    taken = {(each.link, each.type) for each in stated}
    names = {each.name for each in stated}
    others = (each for each in named if (each.link, each.type) not in taken and each.name not in names)
    return (*stated, *others)


def _contacts_on_closing(
    tree: LinkTree, gripper: Gripper, ignored: Collection[tuple[str, str]], notes: list[ModelNote]
) -> set[tuple[str, str]]:
    """The links of a gripper that touch while it closes, except its fingers: such shapes would hold it open."""
    if gripper.type is not GripperType.PARALLEL or len(gripper.joints) > _MAX_DRIVES:
        return set()
    opened, closed = np.array(gripper.open_positions), np.array(gripper.closed_positions)
    rows = (opened + share * (closed - opened) for share in np.linspace(0.0, 1.0, _CLOSING_STATES))
    given = (dict(zip(gripper.joints, row.tolist(), strict=True)) for row in rows)
    states = (tree.poses(rest_positions(tree.joints.values(), each)) for each in given)
    shapes = {link: tree.shape_points(link) for link in tree.subtree(gripper.link)}
    touching = touching_shares(shapes, states, ignored=ignored)
    found = {pair for pair in touching if not set(gripper.finger_links).issuperset(pair)}
    if found:
        pairs = ", ".join(map(" and ".join, sorted(found)))
        text = f"these of its links touch while it closes, and do not collide: {pairs}"
        notes.append(ModelNote(subject=gripper.name, text=text))
    return found


def _self_contacts(
    description: _Description,
    links: tuple[RobotLink, ...],
    joints: tuple[RobotJoint, ...],
    ignored: Collection[tuple[str, str]],
    notes: list[ModelNote],
) -> tuple[tuple[RobotLink, ...], frozenset[tuple[str, str]]]:
    """The links, of which those are divided whose hulls others often touch, and the pairs that always touch.

    Only files without SRDF need this: that states which pairs do not collide.
    """
    found = _find_self_contacts(LinkTree(links, joints), ignored=ignored)
    if not found.often or description.divided is None:
        return links, found.always
    hollow = dict.fromkeys(link for pair in found.often for link in pair)
    geometries = description.divided(hollow.keys())
    divided = tuple(replace(each, geometry=geometries[each.name]) if each.name in hollow else each for each in links)
    for (first, second), share in found.often.items():
        text = (
            f"their hulls touch in {share:.0%} of random states: their collision meshes are divided into convex parts"
        )
        notes.append(ModelNote(subject=f"{first}, {second}", text=text))
    return divided, _find_self_contacts(LinkTree(divided, joints), ignored=ignored).always


class _SelfContacts(NamedTuple):
    """Pairs of links that touch in random states, the lower name first."""

    always: frozenset[tuple[str, str]]
    often: dict[tuple[str, str], float]
    """Those near in the tree that move and touch in some states, with the part of these."""


def _find_self_contacts(tree: LinkTree, *, ignored: Collection[tuple[str, str]]) -> _SelfContacts:
    """Finds the pairs of links that touch in random states, as MoveIt's setup assistant does.

    A pair that touches in nearly all of them says nothing about collisions, such as a bearing and what turns in it. One
    that is near in the tree and touches in some of them often does so only since the hull of one fills a hollow in
    which the other moves.

    What was found is kept in the cache directory, by all that it depends on.

    Args:
        ignored: pairs that are not tested, such as neighbors.
    """
    shapes = [(name, each.geometry.collision_shapes if each.geometry else ()) for name, each in tree.links.items()]
    known = (_program(), shapes, list(tree.joints.values()), sorted(ignored))
    name = blake2b(msgspec.msgpack.encode(known), digest_size=16).hexdigest()
    path = cache_dir("self-contacts") / f"{name}.json"

    def make() -> bytes:
        return msgspec.json.encode([(*pair, share) for pair, share in _touching_shares(tree, ignored).items()])

    content = cached_content(path, make, max_bytes=_MAX_STORED_BYTES)
    try:
        rows = msgspec.json.decode(content, type=list[tuple[str, str, float]])
    except msgspec.DecodeError:  # the file is damaged
        path.unlink(missing_ok=True)
        rows = msgspec.json.decode(make(), type=list[tuple[str, str, float]])
    shares = {(first, second): share for first, second, share in rows}
    return _SelfContacts(
        frozenset(pair for pair, share in shares.items() if share >= _ALWAYS),
        {pair: share for pair, share in shares.items() if share >= _OFTEN and _are_near(tree, *pair)},
    )


@cache
def _program() -> tuple[object, ...]:
    return version("mujoco"), modules_of(Path(__file__).parents[2], ("robots/models", "engines/mujoco", "scene"))


def _touching_shares(tree: LinkTree, ignored: Collection[tuple[str, str]]) -> dict[tuple[str, str], float]:
    random = np.random.default_rng(_SEED)
    drives = [joint for joint in tree.joints.values() if joint.is_actuated]
    low, high = np.clip(np.array([joint.limits for joint in drives]).reshape(-1, 2), -np.pi, np.pi).T
    rows = random.uniform(low, high, (_STATES, len(drives)))
    positions = (dict(zip((joint.name for joint in drives), row.tolist(), strict=True)) for row in rows)
    states = (tree.poses(rest_positions(tree.joints.values(), each)) for each in positions)
    return touching_shares({link: tree.shape_points(link) for link in tree.links}, states, ignored=ignored)


def _are_near(tree: LinkTree, first: str, second: str) -> bool:
    chain = tree.chain(first, second) or tree.chain(second, first)
    return chain is not None and 0 < sum(joint.is_movable for joint in chain) <= _NEAR_JOINTS


def _fixed(joint: RobotJoint) -> RobotJoint:
    return RobotJoint(
        name=joint.name, type=RobotJointType.FIXED, parent=joint.parent, child=joint.child, origin=joint.origin
    )


def _package_folders(path: Path) -> list[Path]:
    """Folders above a description that are, or contain, packages that it refers to: at most five levels up.

    A package is a folder with a `package.xml`, so that no description makes any other folder readable by its name.
    """
    try:
        text = path.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return []
    names = {first or second for first, second in _PACKAGE_NAME.findall(text)}
    found = []
    for folder in list(path.resolve().parents)[:5]:
        if (folder / "package.xml").is_file():
            found += [folder, folder.parent]
        elif any((folder / name / "package.xml").is_file() for name in names):
            found.append(folder)
    return found


def _srdf_beside(path: Path) -> Path | None:
    """The SRDF of a description, beside it or in a folder `srdf` beside or above it.

    Its name is that of the description, or the longest one with which that begins: `talos.srdf` for
    `talos_reduced.urdf`.
    """
    stem = re.split(r"\.(?:urdf|xacro|xml|mjcf)\b", path.name)[0]
    folders = [path.parent, *(folder / "srdf" for folder in list(path.parents)[:2])]
    found = [each for folder in folders if folder.is_dir() for each in sorted(folder.glob("*.srdf"))]
    fitting = [each for each in found if re.match(re.escape(each.stem) + r"(?![a-zA-Z0-9])", stem)]
    return max(fitting, key=lambda each: len(each.stem), default=None)


def _inertia(inertial: UrdfInertial) -> tuple[Inertia, str]:
    """The inertia along the axes of the link, and how its moments were corrected, if they were.

    Moments of a rigid body are positive, and none is greater than the sum of the two others. If they contradict this,
    their mean is used for all, as by `balanceinertia` of MuJoCo.
    """
    row = normalized_pose_array(inertial.origin)
    xx, yy, zz, xy, xz, yz = inertial.tensor
    given = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    moments, axes = np.linalg.eigh(given)
    change = ""
    if moments[0] < 0.0 or moments[2] > (moments[0] + moments[1]) * (1.0 + _MOMENT_TOLERANCE):
        shown = ", ".join(f"{moment:.3g}" for moment in moments)
        change = f"its moments of inertia {shown} are those of no rigid body; their mean is used"
        moments = np.full(3, max(float(np.abs(moments).mean()), 0.0))
    else:
        moments[2] = min(moments[2], moments[0] + moments[1])
    lowest = max(_MIN_INERTIA, _MIN_GYRATION_M**2 * inertial.mass_kg)
    rotation = rotation_matrix(row[3:]) @ axes
    tensor = rotation @ np.diag(np.maximum(moments, lowest)) @ rotation.T
    a, b, c = row[:3].tolist()
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = tensor.tolist()
    return Inertia(mass_kg=inertial.mass_kg, center=(a, b, c), tensor=(xx, yy, zz, xy, xz, yz)), change


def _joints(urdf: UrdfRobot, ranges: Mapping[str, tuple[float, float]]) -> tuple[list[RobotJoint], list[ModelNote]]:
    """The joints with notes; ranges are of those that have none in the description."""
    notes: list[ModelNote] = []
    joints = []
    for joint in urdf.joints:
        if joint.name in ranges and joint.range is not None and joint.range[0] == joint.range[1]:
            lower, upper = ranges[joint.name]
            joint = replace(joint, range=(lower, upper))
            notes.append(
                ModelNote(subject=joint.name, text=f"its range is not stated: {lower:g} to {upper:g} is assumed")
            )
        type, text = _type(joint)
        if text:
            notes.append(ModelNote(subject=joint.name, text=text, is_guess=False))
        joints.append(_joint(joint, type))
    return joints, notes


def _with_mimics(
    joints: Iterable[RobotJoint], mimics: Iterable[tuple[str, str]]
) -> tuple[list[RobotJoint], list[ModelNote]]:
    """The joints, of which some follow others although the description does not say so, and notes."""
    masters, found, notes = dict(mimics), [], []
    for joint in joints:
        if joint.name in masters and joint.is_actuated:
            master = masters[joint.name]
            joint = replace(joint, mimic=RobotMimic(joint=master))
            notes.append(ModelNote(subject=joint.name, text=f"it moves with {master}, as on the real robot"))
        found.append(joint)
    return found, notes


def _couplings(urdf: UrdfRobot) -> dict[str, RobotMimic]:
    """The joints that plugins of Gazebo move with others, by their followers.

    `<virtualJoint>` is of the underactuated fingers of PAL's hands, whose angles are that of their motor divided by a
    factor; `<mimicJoint>` is of the mimic plugin of the Robotics Group.
    """
    found: dict[str, RobotMimic] = {}
    for text in urdf.other_elements:
        if "<plugin" not in text:
            continue
        try:
            plugins = list(ElementTree.fromstring(text).iter("plugin"))
        except ElementTree.ParseError:
            continue  # it has prefixes that are declared outside of it, which no such plugin has
        for plugin in plugins:
            master = (plugin.findtext("actuatedJoint") or plugin.findtext("joint") or "").strip()
            pairs = [(each, 1.0 / _number(each, "scale_factor", 1.0), 0.0) for each in plugin.iter("virtualJoint")]
            names = [(each.findtext("name") or "", multiplier, offset) for each, multiplier, offset in pairs]
            if (follower := plugin.findtext("mimicJoint")) is not None:
                names.append((follower, _number(plugin, "multiplier", 1.0), _number(plugin, "offset", 0.0)))
            for name, multiplier, offset in names:
                if master and name.strip():
                    found[name.strip()] = RobotMimic(joint=master, multiplier=multiplier, offset=offset)
    return found


def _number(element: ElementTree.Element, tag: str, default: float) -> float:
    """A number other than 0 in an element below; the default if it has none."""
    try:
        value = float(element.findtext(tag) or default)
    except ValueError:
        return default
    return value if value and np.isfinite(value) else default


def _with_couplings(
    joints: Sequence[RobotJoint], couplings: Mapping[str, RobotMimic]
) -> tuple[list[RobotJoint], list[ModelNote]]:
    """The joints, of which those follow others that plugins move, and notes.

    The range of a joint that others follow is that in which none of them leaves its own: the plugins stop a follower at
    its limit, which a linear coupling cannot.
    """
    by_name = {joint.name: joint for joint in joints}
    ranges: dict[str, tuple[float, float]] = {}
    followers: dict[str, RobotMimic] = {}
    for name, mimic in couplings.items():
        joint, master = by_name.get(name), by_name.get(mimic.joint)
        if joint is None or master is None or not joint.is_actuated or not master.is_actuated or name == mimic.joint:
            continue
        followers[name] = mimic
        low, high = ranges.get(mimic.joint, (_bound(master.lower, -1.0), _bound(master.upper, 1.0)))
        ends = [(_bound(each, sign) - mimic.offset) / mimic.multiplier for each, sign in _limits(joint)]
        ranges[mimic.joint] = max(low, min(ends)) + 0.0, min(high, max(ends)) + 0.0  # not -0
    links = {by_name[name].parent for name in followers}, {by_name[name].child for name in followers}
    found, notes = [], []
    for joint in joints:
        is_beside = joint.child in links[0] or joint.parent in links[1]
        if joint.is_actuated and is_beside and joint.name not in {*followers, *ranges}:
            text = "it is fixed, since nothing drives it: the joints before or behind it follow others"
            notes.append(ModelNote(subject=joint.name, text=text))
            joint = _fixed(joint)
        elif joint.name in followers:
            mimic = followers[joint.name]
            joint = replace(joint, mimic=mimic)
            text = f"it moves with {mimic.joint}, times {mimic.multiplier:.3g}, as a plugin of Gazebo moves it"
            notes.append(ModelNote(subject=joint.name, text=text))
        elif joint.name in ranges and ranges[joint.name][0] < ranges[joint.name][1]:
            lower, upper = ranges[joint.name]
            if (lower, upper) != (_bound(joint.lower, -1.0), _bound(joint.upper, 1.0)):
                text = f"its range is {lower:.3g} to {upper:.3g}, in which the joints that move with it have room"
                notes.append(ModelNote(subject=joint.name, text=text))
                joint = replace(joint, lower=lower, upper=upper)
        found.append(joint)
    return found, notes


def _limits(joint: RobotJoint) -> tuple[tuple[float | None, float], tuple[float | None, float]]:
    return (joint.lower, -1.0), (joint.upper, 1.0)


def _bound(limit: float | None, sign: float) -> float:
    return sign * np.inf if limit is None else limit


def _type(joint: UrdfJoint) -> tuple[RobotJointType, str]:
    """The type of a joint, and why it is not that of the description."""
    type = _JOINT_TYPES.get(joint.type)
    if type is None:
        return RobotJointType.FIXED, f"a {joint.type.value} joint has several axes; its links are connected rigidly"
    if type in (RobotJointType.REVOLUTE, RobotJointType.PRISMATIC) and joint.range is not None:
        lower, upper = joint.range
        if lower == upper:
            return RobotJointType.FIXED, f"its limits are both {lower:g}, so it is fixed"
        if upper - lower > 2 * _MAX_POSITION and type is RobotJointType.REVOLUTE:
            return RobotJointType.CONTINUOUS, f"its limits {lower:g} and {upper:g} are none"
    if type is RobotJointType.REVOLUTE and joint.range is None:
        return RobotJointType.CONTINUOUS, ""
    return type, ""


def _joint(joint: UrdfJoint, type: RobotJointType) -> RobotJoint:
    lower, upper = (joint.range or (None, None)) if type is not RobotJointType.CONTINUOUS else (None, None)
    mimic = joint.mimic if type is not RobotJointType.FIXED else None
    return RobotJoint(
        name=joint.name,
        type=type,
        parent=joint.parent,
        child=joint.child,
        origin=joint.origin,
        axis=_unit(joint.axis),
        lower=lower,
        upper=upper,
        velocity=_positive(joint.velocity),
        effort=_positive(joint.effort),
        damping=max(joint.damping, 0.0),
        friction=max(joint.friction, 0.0),
        mimic=None
        if mimic is None
        else RobotMimic(joint=mimic.joint, multiplier=mimic.multiplier, offset=mimic.offset),
    )


def _positive(limit: float | None) -> float | None:
    """A limit that limits anything; 0 in a description means that nobody entered one."""
    return limit if limit is not None and 0.0 < limit < _MAX_POSITION * 100 else None


def _unit(axis: Vector) -> Vector:
    x, y, z = (np.array(axis) / np.linalg.norm(axis)).tolist()
    return x, y, z
