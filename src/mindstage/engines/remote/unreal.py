"""UnrealEngine: a world in Unreal, by the services of its plugin UROSWorldControl and by no others.

What the plugin has no service for is an `EngineUnable`: to detach, to push, to keep a state. It has none either that
tells what stands there. So the log is the world as it was given, with the poses that are read, one by one; a pose
that Unreal has only rounded comes back as it was given. Unreal's time is its own and passes as the clock on the wall
does: `step` waits for it.
"""
# ruff: noqa: D102 - the contract documents an engine's methods, once for all

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable, Mapping
from types import MappingProxyType

import numpy as np

from mindstage.bridge.description import colour_code, physics_message, pose_message, pose_rows
from mindstage.engines.contract import Ability, Poses, SpawnReport, State
from mindstage.engines.inventory import Inventory, placeable
from mindstage.engines.remote.address import Profile
from mindstage.engines.remote.delivery import deliver
from mindstage.engines.remote.engine import RemoteEngine
from mindstage.engines.remote.link import Link
from mindstage.engines.remote.plugin import Plugin
from mindstage.errors import EngineError, EngineUnable, EngineUnavailable, PoseUnreachable, WorldError
from mindstage.msgs import world_control_msgs as wire
from mindstage.world import NO_FORMS, BodyId, Colour, Forms, Material, Physics, Pose, Vector, World
from mindstage.world.geometry import pose_array, pose_from, rotation_angle

__all__ = ["UnrealEngine"]

_ROUNDED_M, _ROUNDED_RAD = 2e-6, 1e-5
"""What single precision does to a pose of a metre's size on its way to centimetres and back, and some more."""
_IN_A_ROW_S = 0.5
"""Steps that follow one another so quickly are one stretch of time: what passes between them counts [s]."""
_LOOK_S = 0.5
"""How often it is looked, while time passes, whether Unreal is still there [s]."""
_log = logging.getLogger("mindstage.engines.remote")


class UnrealEngine(RemoteEngine):
    """As much of the contract as the plugin can keep.

    What others take away in Unreal leaves the poses and the log with a warning. When everything is gone, every call
    says so until something is spawned, or all is cleared.
    """

    profile = Profile.UNREAL
    abilities: frozenset[Ability] = frozenset()

    def __init__(
        self, link: Link, *, now_s: Callable[[], float] = time.monotonic, sleep: Callable[[float], None] = time.sleep
    ) -> None:
        """An engine that has spawned nothing yet.

        Args:
            link: to whom the plugin's services are offered.
            now_s: the clock on the wall [s].
            sleep: waits so long [s].
        """
        super().__init__(link)
        self._plugin = Plugin(link)
        self._inventory = Inventory()
        self._unsure: list[World] = []
        """Worlds whose spawning broke off: nobody knows what of them stands."""
        self._world_is_gone = False
        self._now_s, self._sleep = now_s, sleep
        self._began_s = self._stepped_until_s = now_s()

    @classmethod
    def is_offered(cls, link: Link) -> bool:
        """Whether someone at the other end speaks so."""
        return Plugin(link).is_there

    @property
    def time_s(self) -> float:
        """Time on the wall since this engine was made [s]: Unreal does not tell its own, only that it lives."""
        self._open()
        self._plugin.ping()
        return self._now_s() - self._began_s

    def ping(self) -> float:
        self._open()
        start = time.perf_counter()
        self._plugin.ping()
        return time.perf_counter() - start

    # -- the world -----------------------------------------------------------------------------------------------------

    def spawn(self, world: World, *, forms: Forms = NO_FORMS) -> SpawnReport:
        self._open()
        if self._world_is_gone:
            self._begin_anew()
        self._sweep()
        try:
            report, self._inventory = deliver(self._plugin, self._inventory, world)
        except EngineError:
            self._unsure.append(world)
            raise
        return report

    def delete(self, ids: Iterable[BodyId]) -> None:
        inventory = self._here()
        wanted = {inventory.body(id).id: None for id in ids}
        joints = [each.id for each in inventory.constraints.values() if {each.parent, each.child} & wanted.keys()]
        left = self._plugin.delete(wanted)
        self._plugin.delete(joints)
        inventory.remove(wanted.keys() - set(left))
        if left:
            raise WorldError(f"Unreal does not take {', '.join(map(repr, left))} away, and gives no reason")

    def clear(self) -> None:
        self._open()
        self._plugin.call(wire.DeleteAll, _ours(), parts=len(self._inventory.bodies))
        self._plugin.delete([*self._inventory.constraints, *self._inventory.bodies])  # whoever has lost its tags
        self._begin_anew()

    def attach(self, parent: BodyId, child: BodyId) -> None:
        trial = self._here().copy()
        trial.attach(parent, child)
        request = wire.AttachModelToParent.Request(parent_id=parent, child_id=child)
        self._require(self._plugin.call(wire.AttachModelToParent, request).success, f"hang {child!r} on {parent!r}")
        self._inventory = trial

    def detach(self, child: BodyId) -> None:
        inventory = self._here()
        inventory.body(child)
        if child in inventory.parents:
            raise self._unable("detach", "delete that body and spawn it again")

    def log(self) -> World:
        ids, now = self.poses()
        given = pose_array(body.pose for body in self._inventory.bodies.values())
        scale = np.maximum(1.0, np.abs(given[:, :3]).max(axis=1, initial=1.0))
        stayed = (np.abs(now[:, :3] - given[:, :3]).max(axis=1, initial=0.0) <= _ROUNDED_M * scale) & (
            rotation_angle(given[:, 3:], now[:, 3:]) <= _ROUNDED_RAD
        )
        return self._inventory.world({ids[row]: pose_from(now[row]) for row in np.flatnonzero(~stayed).tolist()})

    # -- bodies --------------------------------------------------------------------------------------------------------

    def set_pose(self, id: BodyId, pose: Pose) -> None:
        inventory = self._here()
        inventory.body(id)
        if reason := placeable(pose):
            raise PoseUnreachable(id, reason=reason)
        request = wire.SetModelPose.Request(id=id, pose=pose_message(pose))
        if not self._plugin.call(wire.SetModelPose, request).success:
            raise PoseUnreachable(id, reason="Unreal does not put it there, and gives no reason")
        inventory.replace(id, pose=pose)

    def set_physics(self, id: BodyId, physics: Physics) -> None:
        inventory = self._here()
        inventory.body(id)
        request = wire.SetPhysicsProperties.Request(id=id, physics_properties=physics_message(physics))
        self._require(self._plugin.call(wire.SetPhysicsProperties, request).success, f"change the physics of {id!r}")
        inventory.replace(id, physics=physics)

    def set_materials(self, id: BodyId, materials: tuple[Material, ...]) -> None:
        inventory = self._here()
        inventory.body(id)
        request = wire.SetMaterial.Request(
            id=id,
            material_names=tuple(material.name for material in materials),
            material_paths=tuple(material.path for material in materials),
        )
        self._require(self._plugin.call(wire.SetMaterial, request).success, f"change the material of {id!r}")
        inventory.replace(id, materials=materials)

    def highlight(self, ids: Iterable[BodyId], colour: Colour | None) -> None:
        """Outlines bodies in that of the plugin's five colours which is nearest."""
        inventory = self._here()
        wanted = [inventory.body(id).id for id in ids]
        requests = [wire.HighlightModel.Request(id=id, color=colour_code(colour)) for id in wanted]
        replies = list(self._plugin.call_each(wire.HighlightModel, requests))
        inventory.highlight([id for id, reply in zip(wanted, replies, strict=True) if reply.success], colour)
        for id, reply in zip(wanted, replies, strict=True):
            self._require(reply.success, f"light up {id!r}")

    def highlights(self) -> Mapping[BodyId, Colour]:
        """In the colours that were asked for."""
        return MappingProxyType(self._here().lit)

    def push(self, id: BodyId, force: Vector, at: Vector | None = None) -> None:
        if self._here().body(id).physics.simulates:
            raise self._unable("push bodies", "put them where they shall be with set_pose")

    def poses(self) -> tuple[tuple[BodyId, ...], Poses]:
        inventory = self._here()
        replies = self._plugin.poses(inventory.ids)
        missing = [id for id, reply in zip(inventory.ids, replies, strict=True) if not reply.success]
        if missing and len(missing) == len(replies):
            self._world_is_gone = True
            self._here()
        elif missing:
            _log.warning("%s: no longer there: %s", self.name, ", ".join(missing))
            inventory.remove(missing)
        return inventory.ids, pose_rows([reply.pose for reply in replies if reply.success])

    # -- time and state ------------------------------------------------------------------------------------------------

    def step(self, duration_s: float) -> None:
        """Waits until so much time has passed; steps in a row are one stretch of time."""
        self._here()
        now_s = self._now_s()
        begin_s = self._stepped_until_s if now_s - self._stepped_until_s < _IN_A_ROW_S else now_s
        self._stepped_until_s = end_s = begin_s + duration_s
        while (left_s := end_s - self._now_s()) > 0.0:
            self._sleep(min(left_s, _LOOK_S))
            self._link.be_ready()

    def joint_positions(self) -> Mapping[BodyId, tuple[float, ...]]:
        self._here()
        return {}

    def save(self) -> State:
        self._here()
        raise self._unable("keep its state", "log the world in its place")

    def restore(self, state: State) -> None:
        self._here()
        raise self._unable("bring a state back", "clear, and spawn a world that was logged")

    # -- what stands there ---------------------------------------------------------------------------------------------

    def _here(self) -> Inventory:
        """What was spawned and is still there.

        Raises:
            EngineUnavailable: none of it is.
        """
        self._open()
        if self._world_is_gone:
            cause = "nothing that was spawned is there any more; its level was started anew, or cleared by others"
            raise EngineUnavailable(self.name, cause=cause, remedy="spawn it again, or clear first")
        return self._inventory

    def _sweep(self) -> None:
        """Takes away what may stand of worlds whose spawning broke off; nobody else's models have our tag."""
        while self._unsure:
            known = self._inventory.bodies
            left = [body for body in self._unsure[0].bodies if body.id not in known]
            list(self._plugin.call_each(wire.DeleteAll, [_ours(body.iri) for body in left]))
            del self._unsure[0]

    def _begin_anew(self) -> None:
        self._inventory = Inventory()
        self._unsure.clear()
        self._world_is_gone = False

    def _require(self, success: bool, what: str) -> None:
        if not success:
            raise WorldError(f"Unreal does not {what}, and gives no reason")

    def _unable(self, what: str, remedy: str) -> EngineUnable:
        return EngineUnable(self.name, what=what, remedy=remedy)


def _ours(iri: str = "") -> wire.DeleteAll.Request:
    """All models that Mindstage spawned, or the one of that IRI: they have a tag that nobody else's have."""
    return wire.DeleteAll.Request(
        type_to_delete="Mindstage", key_to_delete="Iri", value_to_delete=iri, ignore_value=not iri
    )
