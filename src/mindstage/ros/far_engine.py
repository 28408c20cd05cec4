"""Far engine: the engine's whole contract as services, so that a Mindstage elsewhere can drive it and lose nothing.

They stand under `NAMESPACE/mindstage/`; `RemoteEngine` is who calls them. Each does exactly what the contract says, in
the stage's own thread.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from secrets import token_hex
from typing import Any

import msgspec

from mindstage.bridge.description import (
    colour_from,
    colour_message,
    forms_from_json,
    from_json,
    point_from,
    pose_from,
    pose_messages,
    vector_from,
    world_from_json,
    world_to_json,
)
from mindstage.engines import Ability, Engine, SpawnReport
from mindstage.errors import EngineError, MessageRefused
from mindstage.msgs import Action, Service, snake_case
from mindstage.msgs import mindstage_msgs as wire
from mindstage.ros.checkpoints import Checkpoints
from mindstage.ros.diagnostics import Diagnostics
from mindstage.ros.job import GoalGivenUp, Job
from mindstage.ros.offer import ActionOffer, ServiceOffer
from mindstage.ros.sight import Sight
from mindstage.stage import Frame
from mindstage.world import BodyId, Iri, Material, Physics, Vector, World

__all__ = ["FarEngine", "spawn_report"]

_SPAWNING_S = 300.0
_STEP_S = 0.1
"""A goal that lets time pass does so in pieces of this length, so that others get their turn [s]."""
_OFFERED = frozenset({Ability.JOINTS, Ability.SAVE})
"""What an engine can do that others can ask of it over the wire."""
_FORMAT_VERSION = World(iri=Iri("")).format_version


class FarEngine:
    """Answers for the engine of a stage."""

    def __init__(self, sight: Sight, diagnostics: Diagnostics) -> None:
        self._sight = sight
        self._stage = sight.stage
        self._diagnostics = diagnostics
        self._states = Checkpoints(sight.stage)
        self._session = token_hex(8)
        self._counted: tuple[tuple[BodyId, ...], int] = ((), 0)
        self._counting = threading.Lock()

    def offers(self) -> Iterator[ServiceOffer]:
        """All services."""
        yield _offer(wire.Describe, self.describe)
        yield _offer(wire.SpawnWorld, self.spawn_world, patience_s=_SPAWNING_S)
        yield _offer(wire.LogWorld, self.log_world)
        yield _offer(wire.Delete, self.delete)
        yield _offer(wire.Clear, self.clear)
        yield _offer(wire.Attach, self.attach)
        yield _offer(wire.Detach, self.detach)
        yield _offer(wire.SetPose, self.set_pose)
        yield _offer(wire.SetPhysics, self.set_physics)
        yield _offer(wire.SetMaterials, self.set_materials)
        yield _offer(wire.Highlight, self.highlight)
        yield _offer(wire.GetHighlights, self.highlights, quick=True)
        yield _offer(wire.Push, self.push)
        yield _offer(wire.Step, self.step, patience_s=_SPAWNING_S)
        yield _offer(wire.SetSpeed, self.set_speed)
        yield _offer(wire.GetPoses, self.poses, quick=True)
        yield _offer(wire.GetJointPositions, self.joint_positions)
        yield _offer(wire.SaveState, self.save)
        yield _offer(wire.RestoreState, self.restore)
        yield _offer(wire.ForgetState, self.forget)

    def actions(self) -> Iterator[ActionOffer]:
        """What takes time."""
        yield ActionOffer(wire.SpawnMap, self.spawn_map, name=_below(wire.SpawnMap))
        yield ActionOffer(wire.Simulate, self.simulate, name=_below(wire.Simulate))

    # -- the world -----------------------------------------------------------------------------------------------------

    def describe(self, _: wire.Describe.Request) -> wire.Describe.Response:
        """What runs here; the engine itself is asked, so an answer means that it lives."""
        self._stage.ping()
        return wire.Describe.Response(
            engine=self._stage.engine_name,
            abilities=tuple(sorted(ability.value for ability in self._stage.abilities & _OFFERED)),
            time_s=self._stage.frame.time_s,
            format_version=_FORMAT_VERSION,
            session=self._session,
            takes=("forms",),
        )

    def spawn_world(self, request: wire.SpawnWorld.Request) -> wire.SpawnWorld.Response:
        """Adds a world."""
        report = self._spawn(world_from_json(request.world), request.forms)
        self._diagnostics.spawned("spawn_world", report)
        return wire.SpawnWorld.Response(success=report.ok, report=spawn_report(report))

    def log_world(self, _: wire.LogWorld.Request) -> wire.LogWorld.Response:
        """Hands the world back."""
        return wire.LogWorld.Response(success=True, world=world_to_json(self._stage.log()))

    def delete(self, request: wire.Delete.Request) -> wire.Delete.Response:
        """Takes bodies away."""
        self._edit("delete", lambda engine: engine.delete(tuple(map(BodyId, request.ids))))
        return wire.Delete.Response(success=True)

    def clear(self, _: wire.Clear.Request) -> wire.Clear.Response:
        """Takes everything away."""
        self._stage.clear()
        return wire.Clear.Response(success=True)

    def attach(self, request: wire.Attach.Request) -> wire.Attach.Response:
        """Hangs one body on another."""
        self._edit("attach", lambda engine: engine.attach(BodyId(request.parent), BodyId(request.child)))
        return wire.Attach.Response(success=True)

    def detach(self, request: wire.Detach.Request) -> wire.Detach.Response:
        """Lets go of a body."""
        self._edit("detach", lambda engine: engine.detach(BodyId(request.child)))
        return wire.Detach.Response(success=True)

    # -- one body ------------------------------------------------------------------------------------------------------

    def set_pose(self, request: wire.SetPose.Request) -> wire.SetPose.Response:
        """Puts a body somewhere else."""
        pose = pose_from(request.pose)
        self._stage.call(lambda engine: engine.set_pose(BodyId(request.id), pose), what="set pose")
        return wire.SetPose.Response(success=True)

    def set_physics(self, request: wire.SetPhysics.Request) -> wire.SetPhysics.Response:
        """Changes how a body takes part in the physics."""
        physics = from_json(request.physics, Physics)
        self._edit("set physics", lambda engine: engine.set_physics(BodyId(request.id), physics))
        return wire.SetPhysics.Response(success=True)

    def set_materials(self, request: wire.SetMaterials.Request) -> wire.SetMaterials.Response:
        """Changes a body's surface."""
        materials = from_json(request.materials, tuple[Material, ...])
        self._edit("set materials", lambda engine: engine.set_materials(BodyId(request.id), materials))
        return wire.SetMaterials.Response(success=True)

    def highlight(self, request: wire.Highlight.Request) -> wire.Highlight.Response:
        """Lights bodies up in any colour, or puts them out."""
        colour = colour_from(request.color) if request.lit else None
        self._stage.highlight(map(BodyId, request.ids), colour)
        return wire.Highlight.Response(success=True)

    def highlights(self, _: wire.GetHighlights.Request) -> wire.GetHighlights.Response:
        """What is lit."""
        lit = self._sight.frame().highlights
        return wire.GetHighlights.Response(
            success=True, ids=tuple(lit), colors=tuple(map(colour_message, lit.values()))
        )

    def push(self, request: wire.Push.Request) -> wire.Push.Response:
        """Applies a force throughout the next step."""
        force, at = vector_from(request.force), _point(request)
        self._stage.call(lambda engine: engine.push(BodyId(request.id), force, at), what="push")
        return wire.Push.Response(success=True)

    # -- time and state ------------------------------------------------------------------------------------------------

    def step(self, request: wire.Step.Request) -> wire.Step.Response:
        """Lets time pass in one go, as the contract has it: what is pushed is pushed throughout."""
        duration_s = _duration(request.duration_s)
        forces = [(BodyId(each.id), vector_from(each.force), _point(each)) for each in request.forces]

        def step(engine: Engine) -> None:
            for id, force, at in forces:
                engine.push(id, force, at)
            engine.step(duration_s)

        self._stage.call(step, what="step", timeout_s=self._stage.timeout_s * (1.0 + 6.0 * duration_s))
        frame = self._stage.frame
        told = wire.Step.Response(success=True, time_s=frame.time_s)
        return msgspec.structs.replace(told, **self._packed(frame)) if request.packed else told

    def set_speed(self, request: wire.SetSpeed.Request) -> wire.SetSpeed.Response:
        """Lets time pass by itself, or only by steps, for whoever drives the engine."""
        frame = self._stage.frame
        before = frame.speed if frame.playing else 0.0
        if request.speed < 0.0:
            raise MessageRefused("a speed", path="speed", cause=f"time does not pass backwards ({request.speed:g})")
        if request.speed:
            self._stage.play(speed=request.speed)
            self._stage.ping()  # so that the frame tells of it when the reply is there
        else:
            self._stage.pause()
        return wire.SetSpeed.Response(success=True, before=before)

    def poses(self, request: wire.GetPoses.Request) -> wire.GetPoses.Response:
        """Where everything is."""
        frame = self._sight.frame()
        revision = self._revision(frame)
        ids = () if request.known == revision else frame.ids
        told = wire.GetPoses.Response(success=True, time_s=frame.time_s, ids=ids, revision=revision)
        if request.packed:
            return msgspec.structs.replace(told, **self._packed(frame))
        return msgspec.structs.replace(told, poses=pose_messages(frame.poses))

    def joint_positions(self, _: wire.GetJointPositions.Request) -> wire.GetJointPositions.Response:
        """How far constraints have moved."""
        if Ability.JOINTS not in self._stage.abilities:
            raise EngineError(f"the engine {self._stage.engine_name!r} cannot tell where joints stand")
        positions = self._stage.call(lambda engine: engine.joint_positions(), what="joint positions")
        return wire.GetJointPositions.Response(
            success=True, joints=tuple(_joint(id, numbers) for id, numbers in positions.items())
        )

    def save(self, _: wire.SaveState.Request) -> wire.SaveState.Response:
        """Keeps the state here."""
        return wire.SaveState.Response(success=True, handle=self._states.save())

    def restore(self, request: wire.RestoreState.Request) -> wire.RestoreState.Response:
        """Brings a state back."""
        reason = self._states.restore(request.handle)
        if reason:
            raise EngineError(reason)
        return wire.RestoreState.Response(success=True)

    def forget(self, request: wire.ForgetState.Request) -> wire.ForgetState.Response:
        """Throws a state away."""
        self._states.forget(request.handle)
        return wire.ForgetState.Response(success=True)

    # -- what takes time -----------------------------------------------------------------------------------------------

    def spawn_map(self, goal: wire.SpawnMap.Goal, job: Job) -> wire.SpawnMap.Result:
        """Spawns a world; one that was given up meanwhile is taken away again."""

        def told(phase: str, done: int) -> wire.SpawnMap.Feedback:
            return wire.SpawnMap.Feedback(phase=phase, done=done, total=total)

        total = 0
        job.proceed(lambda: told("reading", 0))
        world = world_from_json(goal.world)
        total = len(world.bodies) + len(world.constraints) + len(world.attachments)
        before = set(self._sight.frame().ids)
        with job.telling(lambda: told("spawning", 0)):
            report = self._spawn(world, goal.forms)
        if job.cancelled:
            there = set(self._sight.frame().ids)
            spawned = [body.id for body in world.bodies if body.id in there and body.id not in before]
            self._edit("delete", lambda engine: engine.delete(spawned))
            raise GoalGivenUp
        job.tell(told("spawned", report.bodies + report.constraints + report.attachments))
        self._diagnostics.spawned("spawn_map", report)
        return wire.SpawnMap.Result(success=report.ok, report=spawn_report(report))

    def simulate(self, goal: wire.Simulate.Goal, job: Job) -> wire.Simulate.Result:
        """Lets time pass."""
        duration_s = _duration(goal.duration_s)
        elapsed_s = 0.0

        def told() -> wire.Simulate.Feedback:
            return wire.Simulate.Feedback(elapsed_s=elapsed_s, remaining_s=duration_s - elapsed_s)

        while elapsed_s < duration_s:
            job.proceed(told)
            piece_s = min(_STEP_S, duration_s - elapsed_s)
            self._stage.step(piece_s)
            elapsed_s = elapsed_s + piece_s if duration_s - elapsed_s > _STEP_S else duration_s
        return wire.Simulate.Result(success=True, time_s=self._stage.frame.time_s)

    def _spawn(self, world: World, forms: str) -> SpawnReport:
        """Spawns a world, of the forms that came with it, or else of those that are known here."""
        return self._stage.spawn(world, forms=forms_from_json(forms)) if forms else self._stage.spawn(world)

    def _revision(self, frame: Frame) -> int:
        """The number of the bodies in a frame: another one whenever some came or went."""
        with self._counting:
            ids, number = self._counted
            if ids is not frame.ids:
                self._counted = frame.ids, number + 1
            return self._counted[1]

    def _packed(self, frame: Frame) -> dict[str, Any]:
        return {"revision": self._revision(frame), "rows": frame.poses.astype("<f8").tobytes()}

    def _edit(self, what: str, edit: Callable[[Engine], None]) -> None:
        self._stage.call(edit, what=what, edits=True)


def spawn_report(report: SpawnReport) -> wire.SpawnReport:
    """A report for the wire."""
    return msgspec.convert(msgspec.to_builtins(report), wire.SpawnReport)


def _offer(type: type[Service], answer: Callable[[Any], Any], **options: Any) -> ServiceOffer:
    return ServiceOffer(type, answer, name=_below(type), **options)


def _below(type: type[Service] | type[Action]) -> str:
    return f"mindstage/{snake_case(type)}"


def _joint(id: str, numbers: tuple[float, ...]) -> wire.JointPosition:
    x, y, z, twist, swing2, swing1 = numbers
    return wire.JointPosition(id=id, x=x, y=y, z=z, twist=twist, swing2=swing2, swing1=swing1)


def _point(push: wire.Push.Request | wire.Force) -> Vector | None:
    return point_from(push.point) if push.at_point else None


def _duration(duration_s: float) -> float:
    if duration_s < 0.0:
        raise MessageRefused("a step", path="duration_s", cause=f"time does not pass backwards ({duration_s:g} s)")
    return duration_s
