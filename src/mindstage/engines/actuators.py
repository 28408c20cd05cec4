"""The actuators of a running world, independent of the engine that simulates them.

An actuator exerts its effort along one axis of a joint, from the map's parent on its child. Positions are displacements
since the joint was spawned, as in `Engine.joint_positions`.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

from mindstage.engines.base import Actuator, ActuatorMode
from mindstage.engines.edits import SetActuators, SimulatedBodies
from mindstage.engines.entity_registry import EntityRegistry
from mindstage.engines.kinematic_tree import AXIS_NAMES, is_ball, movable_axes
from mindstage.errors import BodyNotFoundError, closest_names
from mindstage.scene import NO_GEOMETRY, BodyId, GeometryMap, Joint

__all__ = ["ActuatedBodies", "ActuatorSet", "driven_axis"]


@dataclass(frozen=True, slots=True, kw_only=True)
class ActuatedBodies:
    """Bodies with actuators, such as a robot, of a world that is written to a file."""

    actuators: tuple[Actuator, ...]
    commands: Mapping[str, float] = field(default_factory=dict)
    """The commands by name, positions relative to the poses of the world; 0 for the others."""
    without_weight: frozenset[BodyId] = frozenset()
    """The bodies whose weight is compensated."""
    excluded_pairs: frozenset[tuple[BodyId, BodyId]] = frozenset()
    """Pairs of bodies without contacts; see `Spawn.excluded_pairs`."""
    geometry: GeometryMap = field(default_factory=lambda: NO_GEOMETRY)
    """Geometry that is not known to shape rules."""


@dataclass(slots=True)
class ActuatorSet:
    """The actuators of a world with their commands."""

    actuators: dict[str, Actuator] = field(default_factory=dict)
    axes: dict[str, int] = field(default_factory=dict)
    """The axis of each, an index into `AXIS_NAMES`."""
    commands: dict[str, float] = field(default_factory=dict)
    """Without those of actuators whose first command is their position, until it is known."""
    weightless: set[BodyId] = field(default_factory=set)
    """The bodies whose weight is compensated."""

    def copy(self) -> ActuatorSet:
        """An independent copy."""
        return ActuatorSet(dict(self.actuators), dict(self.axes), dict(self.commands), set(self.weightless))

    def apply(self, edit: SetActuators, *, registry: EntityRegistry, joints: Mapping[BodyId, Joint]) -> None:
        """Adds and removes actuators; see `SetActuators`.

        Args:
            edit: the edit.
            registry: the bodies and joints of the world.
            joints: the joints that are simulated with other limits than those of the registry.
        """
        added = {each.name: each for each in edit.actuators}
        axes = {name: driven_axis(each, registry, joints) for name, each in added.items()}
        bodies = {registry.body(id).id for id in edit.without_weight}
        replaced = added.keys() | set(edit.removed)
        owners = {(each.joint, self.axes[name]): name for name, each in self.actuators.items() if name not in replaced}
        for name, each in added.items():
            other = owners.setdefault((each.joint, axes[name]), name)
            if other != name:
                axis = AXIS_NAMES[axes[name]]
                raise ValueError(f"{name!r} drives the axis {axis!r} of {each.joint!r}, which {other!r} drives already")
        for name in replaced & self.actuators.keys():
            self._remove(name)
        self.actuators |= added
        self.axes |= axes
        self.commands |= {name: 0.0 for name, each in added.items() if each.mode is not ActuatorMode.POSITION}
        self.commands |= {name: command for name, command in edit.commands.items() if name in self.actuators}
        self.weightless = (self.weightless - set(edit.with_weight)) | bodies

    def inverse(self, edit: SetActuators) -> SetActuators:
        """The edit that restores the actuators as they are before another one."""
        names = {each.name for each in edit.actuators}
        lost = (names | set(edit.removed)) & self.actuators.keys()
        return SetActuators(
            tuple(each for name, each in self.actuators.items() if name in lost),
            without_weight=tuple(sorted(self.weightless.intersection(edit.with_weight))),
            removed=tuple(sorted(names - self.actuators.keys())),
            with_weight=tuple(sorted(set(edit.without_weight) - self.weightless)),
            commands={name: command for name, command in self.commands.items() if name in lost},
        )

    def set_commands(self, commands: Mapping[str, float]) -> None:
        """See `Engine.set_commands`; nothing changes if it raises."""
        for name in commands.keys() - self.actuators.keys():
            near = closest_names(name, self.actuators)
            raise KeyError(f"no actuator {name!r}; near: {', '.join(near) or 'none'}")
        self.commands |= commands

    def remove(self, removed: Collection[BodyId], *, remaining_joints: Collection[BodyId]) -> None:
        """Removes the actuators of joints that no longer exist, and bodies without weight.

        Args:
            removed: the removed bodies.
            remaining_joints: the joints that still exist.
        """
        self.weightless -= set(removed)
        for name in [name for name, each in self.actuators.items() if each.joint not in remaining_joints]:
            self._remove(name)

    def _remove(self, name: str) -> None:
        del self.actuators[name], self.axes[name]
        self.commands.pop(name, None)

    def restore(self, before: SimulatedBodies, *, registry: EntityRegistry, joints: Mapping[BodyId, Joint]) -> None:
        """Adds the earlier actuators of joints that were removed and exist again, and bodies without weight."""
        found = [each for each in before.actuators if each.joint in registry.joints and each.name not in self.actuators]
        self.axes |= {each.name: driven_axis(each, registry, joints) for each in found}
        self.actuators |= {each.name: each for each in found}
        self.commands |= {each.name: before.commands[each.name] for each in found if each.name in before.commands}
        self.weightless |= before.weightless

    @property
    def driven_joints(self) -> frozenset[BodyId]:
        """The joints that have actuators."""
        return frozenset(each.joint for each in self.actuators.values())


def driven_axis(actuator: Actuator, registry: EntityRegistry, joints: Mapping[BodyId, Joint]) -> int:
    """The axis that an actuator drives, an index into `AXIS_NAMES`.

    Args:
        actuator: the actuator.
        registry: the bodies and joints of the world.
        joints: the joints that are simulated with other limits than those of the registry.

    Raises:
        BodyNotFoundError: there is no such joint.
        ValueError: the joint cannot move along the axis.
    """
    name, id = actuator.name, actuator.joint
    joint = joints.get(id) or registry.joints.get(id)
    if joint is None:
        raise BodyNotFoundError(id, known=registry.joints)
    if actuator.axis and actuator.axis not in AXIS_NAMES:
        raise ValueError(f"{name!r} has the axis {actuator.axis!r}; it is one of {', '.join(AXIS_NAMES)}")
    axes = movable_axes(joint)
    movable = [axis.index for axis in axes]
    wanted = AXIS_NAMES.index(actuator.axis) if actuator.axis else min(movable, default=-1)
    if wanted not in movable:
        can = ", ".join(AXIS_NAMES[index] for index in sorted(movable))
        raise ValueError(f"{name!r} cannot drive {id!r} along {actuator.axis!r}: it moves along {can or 'no axis'}")
    if wanted >= _FIRST_HINGE and is_ball(axes):
        raise ValueError(f"{name!r} cannot drive {id!r}, whose three rotations are free")
    return wanted


_FIRST_HINGE = 3
"""Index of the first rotational axis of a joint; a count."""
