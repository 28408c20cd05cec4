"""Far engine: the engine's whole contract as services, so that a Mindstage elsewhere can drive it and lose nothing.

They stand under `NAMESPACE/mindstage/`; `RemoteEngine` is who calls them. Each does exactly what the contract says, in
the stage's own thread.

Checkpoints: whole states of the engine under names, a bounded number of them.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from itertools import count
from secrets import token_hex
from typing import Any

import msgspec

from mindstage.bridge.conversions import (
    color_from_message,
    color_message,
    from_json,
    geometry_from_json,
    point_from_message,
    pose_array_messages,
    pose_from_message,
    vector_from_message,
    world_from_json,
    world_to_json,
)
from mindstage.engines import Capability, Engine, SavedState, SpawnReport
from mindstage.errors import EngineError, MessageValidationError
from mindstage.msgs import Action, Service, snake_case
from mindstage.msgs import mindstage_msgs as wire
from mindstage.ros.diagnostics import DiagnosticsPublisher
from mindstage.ros.service import ActionSpec, GoalCanceled, GoalContext, ServiceSpec
from mindstage.ros.state import StateReader
from mindstage.scene import BodyId, BodyPhysics, Iri, Material, Vector, World
from mindstage.simulation import Simulation, StateSnapshot

__all__ = ["CheckpointServices", "EngineServices", "spawn_report"]


_MAX_CHECKPOINTS = 64
"""So many states are kept: each holds a whole world."""


class CheckpointServices:
    """Keeps states; any thread may call it."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._states: dict[str, SavedState] = {}
        self._next_number = count(1)

    def execute(self, command: str, name: str) -> str:
        """Does what a word says; gives the reason if the world cannot.

        Raises:
            MessageValidationError: there is no such word.
            EngineError: the engine cannot keep states, or there are too many.
        """
        match command:
            case "save":
                self.save(name)
            case "restore":
                return self.restore(name)
            case "forget":
                self.discard(name)
            case _:
                cause = f"no command {command!r}"
                raise MessageValidationError(
                    "Checkpoint", path="command", cause=cause, remedy="there is save, restore, forget"
                )
        return ""

    def save(self, name: str = "") -> str:
        """Keeps the state as it is now; gives its name, which is made if none is given."""
        name = name or f"state_{next(self._next_number)}"
        self._require_save_support()
        if len(self._states) >= _MAX_CHECKPOINTS and name not in self._states:
            raise EngineError(f"{_MAX_CHECKPOINTS} states are kept already; forget one first")
        self._states[name] = self._simulation.run_on_engine(lambda engine: engine.save_state(), label="save")
        return name

    def restore(self, name: str) -> str:
        """Brings a state back; gives the reason if there is none of that name."""
        self._require_save_support()
        state = self._states.get(name)
        if state is None:
            return f"no state {name!r} is kept; there is {', '.join(sorted(self._states)) or 'none'}"
        self._simulation.run_on_engine(lambda engine: engine.restore_state(state), label="restore", edits=True)
        return ""

    def discard(self, name: str) -> None:
        """Throws a state away; nothing happens if there is none."""
        self._states.pop(name, None)

    def _require_save_support(self) -> None:
        if Capability.SAVE not in self._simulation.capabilities:
            raise EngineError(f"the engine {self._simulation.engine_name!r} cannot keep its state")


_SPAWN_TIMEOUT_S = 300.0
_STEP_CHUNK_S = 0.1
"""A goal that lets time pass does so in pieces of this length, so that others get their turn [s]."""
_REMOTE_CAPABILITIES = frozenset({Capability.JOINTS, Capability.SAVE})
"""What an engine can do that others can ask of it over the wire."""
_FORMAT_VERSION = World(iri=Iri("")).format_version


class EngineServices:
    """Answers for the engine of a stage."""

    def __init__(self, state_reader: StateReader, diagnostics: DiagnosticsPublisher) -> None:
        self._state_reader = state_reader
        self._simulation = state_reader.simulation
        self._diagnostics = diagnostics
        self._states = CheckpointServices(state_reader.simulation)
        self._session = token_hex(8)
        self._revision_state: tuple[tuple[BodyId, ...], int] = ((), 0)
        self._revision_lock = threading.Lock()

    def services(self) -> Iterator[ServiceSpec]:
        """All services."""
        yield _service_spec(wire.Describe, self.describe)
        yield _service_spec(wire.SpawnWorld, self.spawn_world, patience_s=_SPAWN_TIMEOUT_S)
        yield _service_spec(wire.LogWorld, self.snapshot_world)
        yield _service_spec(wire.Delete, self.delete)
        yield _service_spec(wire.Clear, self.clear)
        yield _service_spec(wire.Attach, self.attach)
        yield _service_spec(wire.Detach, self.detach)
        yield _service_spec(wire.SetPose, self.set_pose)
        yield _service_spec(wire.SetPhysics, self.set_physics)
        yield _service_spec(wire.SetMaterials, self.set_materials)
        yield _service_spec(wire.Highlight, self.highlight)
        yield _service_spec(wire.GetHighlights, self.highlights, quick=True)
        yield _service_spec(wire.Push, self.apply_force)
        yield _service_spec(wire.Step, self.step, patience_s=_SPAWN_TIMEOUT_S)
        yield _service_spec(wire.SetSpeed, self.set_speed)
        yield _service_spec(wire.GetPoses, self.poses, quick=True)
        yield _service_spec(wire.GetJointPositions, self.joint_positions)
        yield _service_spec(wire.SaveState, self.save_state)
        yield _service_spec(wire.RestoreState, self.restore_state)
        yield _service_spec(wire.ForgetState, self.discard_state)

    def actions(self) -> Iterator[ActionSpec]:
        """What takes time."""
        yield ActionSpec(wire.SpawnMap, self.spawn_map, name=_service_name(wire.SpawnMap))
        yield ActionSpec(wire.Simulate, self.simulate, name=_service_name(wire.Simulate))

    # -- the world -----------------------------------------------------------------------------------------------------

    def describe(self, _: wire.Describe.Request) -> wire.Describe.Response:
        """What runs here; the engine itself is asked, so an answer means that it lives."""
        self._simulation.ping()
        return wire.Describe.Response(
            engine=self._simulation.engine_name,
            abilities=tuple(sorted(ability.value for ability in self._simulation.capabilities & _REMOTE_CAPABILITIES)),
            time_s=self._simulation.state.time_s,
            format_version=_FORMAT_VERSION,
            session=self._session,
            takes=("forms",),
        )

    def spawn_world(self, request: wire.SpawnWorld.Request) -> wire.SpawnWorld.Response:
        """Adds a world."""
        report = self._spawn(world_from_json(request.world), request.forms)
        self._diagnostics.report_spawn("spawn_world", report)
        return wire.SpawnWorld.Response(success=report.ok, report=spawn_report(report))

    def snapshot_world(self, _: wire.LogWorld.Request) -> wire.LogWorld.Response:
        """Hands the world back."""
        return wire.LogWorld.Response(success=True, world=world_to_json(self._simulation.snapshot()))

    def delete(self, request: wire.Delete.Request) -> wire.Delete.Response:
        """Takes bodies away."""
        self._edit("delete", lambda engine: engine.delete(tuple(map(BodyId, request.ids))))
        return wire.Delete.Response(success=True)

    def clear(self, _: wire.Clear.Request) -> wire.Clear.Response:
        """Takes everything away."""
        self._simulation.clear()
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
        pose = pose_from_message(request.pose)
        self._simulation.run_on_engine(lambda engine: engine.set_pose(BodyId(request.id), pose), label="set pose")
        return wire.SetPose.Response(success=True)

    def set_physics(self, request: wire.SetPhysics.Request) -> wire.SetPhysics.Response:
        """Changes how a body takes part in the physics."""
        physics = from_json(request.physics, BodyPhysics)
        self._edit("set physics", lambda engine: engine.set_physics(BodyId(request.id), physics))
        return wire.SetPhysics.Response(success=True)

    def set_materials(self, request: wire.SetMaterials.Request) -> wire.SetMaterials.Response:
        """Changes a body's surface."""
        materials = from_json(request.materials, tuple[Material, ...])
        self._edit("set materials", lambda engine: engine.set_materials(BodyId(request.id), materials))
        return wire.SetMaterials.Response(success=True)

    def highlight(self, request: wire.Highlight.Request) -> wire.Highlight.Response:
        """Lights bodies up in any color, or puts them out."""
        color = color_from_message(request.color) if request.lit else None
        self._simulation.highlight(map(BodyId, request.ids), color)
        return wire.Highlight.Response(success=True)

    def highlights(self, _: wire.GetHighlights.Request) -> wire.GetHighlights.Response:
        """What is lit."""
        lit = self._state_reader.state().highlights
        return wire.GetHighlights.Response(success=True, ids=tuple(lit), colors=tuple(map(color_message, lit.values())))

    def apply_force(self, request: wire.Push.Request) -> wire.Push.Response:
        """Applies a force throughout the next step."""
        force, at = vector_from_message(request.force), _force_point(request)
        self._simulation.run_on_engine(lambda engine: engine.apply_force(BodyId(request.id), force, at), label="push")
        return wire.Push.Response(success=True)

    # -- time and state ------------------------------------------------------------------------------------------------

    def step(self, request: wire.Step.Request) -> wire.Step.Response:
        """Lets time pass in one go, as the contract has it: what is pushed is pushed throughout."""
        duration_s = _valid_duration(request.duration_s)
        forces = [(BodyId(each.id), vector_from_message(each.force), _force_point(each)) for each in request.forces]

        def step(engine: Engine) -> None:
            for id, force, at in forces:
                engine.apply_force(id, force, at)
            engine.step(duration_s)

        self._simulation.run_on_engine(
            step, label="step", timeout_s=self._simulation.timeout_s * (1.0 + 6.0 * duration_s)
        )
        frame = self._simulation.state
        told = wire.Step.Response(success=True, time_s=frame.time_s)
        return msgspec.structs.replace(told, **self._pose_bytes(frame)) if request.packed else told

    def set_speed(self, request: wire.SetSpeed.Request) -> wire.SetSpeed.Response:
        """Lets time pass by itself, or only by steps, for whoever drives the engine."""
        frame = self._simulation.state
        before = frame.speed if frame.playing else 0.0
        if request.speed < 0.0:
            raise MessageValidationError(
                "a speed", path="speed", cause=f"time does not pass backwards ({request.speed:g})"
            )
        if request.speed:
            self._simulation.play(speed=request.speed)
            self._simulation.ping()  # so that the frame tells of it when the reply is there
        else:
            self._simulation.pause()
        return wire.SetSpeed.Response(success=True, before=before)

    def poses(self, request: wire.GetPoses.Request) -> wire.GetPoses.Response:
        """Where everything is."""
        frame = self._state_reader.state()
        revision = self._revision(frame)
        ids = () if request.known == revision else frame.ids
        told = wire.GetPoses.Response(success=True, time_s=frame.time_s, ids=ids, revision=revision)
        if request.packed:
            return msgspec.structs.replace(told, **self._pose_bytes(frame))
        return msgspec.structs.replace(told, poses=pose_array_messages(frame.poses))

    def joint_positions(self, _: wire.GetJointPositions.Request) -> wire.GetJointPositions.Response:
        """How far constraints have moved."""
        if Capability.JOINTS not in self._simulation.capabilities:
            raise EngineError(f"the engine {self._simulation.engine_name!r} cannot tell where joints stand")
        positions = self._simulation.run_on_engine(lambda engine: engine.joint_positions(), label="joint positions")
        return wire.GetJointPositions.Response(
            success=True, joints=tuple(_joint_message(id, numbers) for id, numbers in positions.items())
        )

    def save_state(self, _: wire.SaveState.Request) -> wire.SaveState.Response:
        """Keeps the state here."""
        return wire.SaveState.Response(success=True, handle=self._states.save())

    def restore_state(self, request: wire.RestoreState.Request) -> wire.RestoreState.Response:
        """Brings a state back."""
        reason = self._states.restore(request.handle)
        if reason:
            raise EngineError(reason)
        return wire.RestoreState.Response(success=True)

    def discard_state(self, request: wire.ForgetState.Request) -> wire.ForgetState.Response:
        """Throws a state away."""
        self._states.discard(request.handle)
        return wire.ForgetState.Response(success=True)

    # -- what takes time -----------------------------------------------------------------------------------------------

    def spawn_map(self, goal: wire.SpawnMap.Goal, context: GoalContext) -> wire.SpawnMap.Result:
        """Spawns a world; one that was given up meanwhile is taken away again."""

        def told(phase: str, done: int) -> wire.SpawnMap.Feedback:
            return wire.SpawnMap.Feedback(phase=phase, done=done, total=total)

        total = 0
        context.check(lambda: told("reading", 0))
        world = world_from_json(goal.world)
        total = len(world.bodies) + len(world.joints) + len(world.attachments)
        before = set(self._state_reader.state().ids)
        with context.sending_feedback(lambda: told("spawning", 0)):
            report = self._spawn(world, goal.forms)
        if context.cancelled:
            there = set(self._state_reader.state().ids)
            spawned = [body.id for body in world.bodies if body.id in there and body.id not in before]
            self._edit("delete", lambda engine: engine.delete(spawned))
            raise GoalCanceled
        context.send_feedback(told("spawned", report.bodies + report.joints + report.attachments))
        self._diagnostics.report_spawn("spawn_map", report)
        return wire.SpawnMap.Result(success=report.ok, report=spawn_report(report))

    def simulate(self, goal: wire.Simulate.Goal, context: GoalContext) -> wire.Simulate.Result:
        """Lets time pass."""
        duration_s = _valid_duration(goal.duration_s)
        elapsed_s = 0.0

        def told() -> wire.Simulate.Feedback:
            return wire.Simulate.Feedback(elapsed_s=elapsed_s, remaining_s=duration_s - elapsed_s)

        while elapsed_s < duration_s:
            context.check(told)
            piece_s = min(_STEP_CHUNK_S, duration_s - elapsed_s)
            self._simulation.step(piece_s)
            elapsed_s = elapsed_s + piece_s if duration_s - elapsed_s > _STEP_CHUNK_S else duration_s
        return wire.Simulate.Result(success=True, time_s=self._simulation.state.time_s)

    def _spawn(self, world: World, geometry: str) -> SpawnReport:
        """Spawns a world, of the forms that came with it, or else of those that are known here."""
        return (
            self._simulation.spawn(world, geometry=geometry_from_json(geometry))
            if geometry
            else self._simulation.spawn(world)
        )

    def _revision(self, frame: StateSnapshot) -> int:
        """The number of the bodies in a frame: another one whenever some came or went."""
        with self._revision_lock:
            ids, number = self._revision_state
            if ids is not frame.ids:
                self._revision_state = frame.ids, number + 1
            return self._revision_state[1]

    def _pose_bytes(self, frame: StateSnapshot) -> dict[str, Any]:
        return {"revision": self._revision(frame), "rows": frame.poses.astype("<f8").tobytes()}

    def _edit(self, label: str, edit: Callable[[Engine], None]) -> None:
        self._simulation.run_on_engine(edit, label=label, edits=True)


def spawn_report(report: SpawnReport) -> wire.SpawnReport:
    """A report for the wire."""
    return msgspec.convert(msgspec.to_builtins(report), wire.SpawnReport)


def _service_spec(type: type[Service], handler: Callable[[Any], Any], **options: Any) -> ServiceSpec:
    return ServiceSpec(type, handler, name=_service_name(type), **options)


def _service_name(type: type[Service] | type[Action]) -> str:
    return f"mindstage/{snake_case(type)}"


def _joint_message(id: str, numbers: tuple[float, ...]) -> wire.JointPosition:
    x, y, z, twist, swing2, swing1 = numbers
    return wire.JointPosition(id=id, x=x, y=y, z=z, twist=twist, swing2=swing2, swing1=swing1)


def _force_point(push: wire.Push.Request | wire.Force) -> Vector | None:
    return point_from_message(push.point) if push.at_point else None


def _valid_duration(duration_s: float) -> float:
    if duration_s < 0.0:
        raise MessageValidationError(
            "a step", path="duration_s", cause=f"time does not pass backwards ({duration_s:g} s)"
        )
    return duration_s
