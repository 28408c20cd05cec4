"""Services and actions for the whole `Engine` protocol, which another Mindstage uses without loss (`RemoteEngine`).

Their names begin with `NAMESPACE/mindstage/`. Each has the effect of a method of `Engine`, in the thread of the
simulation. `CheckpointServices` keeps a bounded number of named states of the engine.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path
from secrets import token_hex
from typing import TYPE_CHECKING, Any

import msgspec

from mindstage.access.limits import CHECKPOINTS, SPEED, STEP_DURATION
from mindstage.access.policies import EDIT, FILE, GOAL, READ, RUN, SPAWN, Policy
from mindstage.bridge.conversions import (
    FORMAT_VERSION,
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
from mindstage.engines import Actuator, Capability, Engine, SavedState, SpawnReport
from mindstage.engines.edits import SetActuators
from mindstage.errors import EngineError, EpisodeError, MessageValidationError
from mindstage.msgs import Action, Service, snake_case
from mindstage.msgs import mindstage_msgs as wire
from mindstage.ros.diagnostics import DiagnosticsPublisher
from mindstage.ros.service import ActionSpec, GoalCanceledError, GoalContext, ServiceSpec
from mindstage.ros.state import StateReader
from mindstage.scene import BodyId, BodyPhysics, Material, Vector, World
from mindstage.scene.edits import (
    Attach,
    Delete,
    Detach,
    GeometryEdit,
    SetLabel,
    SetMaterials,
    SetPhysics,
    SetPoses,
    edit_from_json,
    edit_to_json,
)
from mindstage.simulation import Simulation, StateSnapshot

if TYPE_CHECKING:
    from mindstage.episodes.recorder import RecordingFolder

__all__ = ["CheckpointServices", "EngineServices", "RecordingServices", "spawn_report"]


_RECORDING_RATE_HZ = 30.0
_STEP_CHUNK_S = 0.1
"""Length of the steps into which a goal is divided, so that other calls run in between [s]."""
_SLICE_WALL_S = 0.02
"""Wall time after which a step is interrupted, so that other calls are executed [s]."""
_REMOTE_CAPABILITIES = frozenset(
    {Capability.JOINTS, Capability.SAVE, Capability.ACTUATORS, Capability.KINEMATIC_VELOCITIES}
)
"""Capabilities of the engine that clients can use."""


class CheckpointServices:
    """Saved states of the engine by name; can be used from any thread."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._states: dict[str, SavedState] = {}
        self._next_number = count(1)

    def execute(self, command: str, name: str) -> str:
        """Executes the command `save`, `restore` or `forget`; returns why it failed, or an empty string.

        Raises:
            MessageValidationError: there is no such command.
            EngineError: the engine cannot save states, or there are too many.
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
                    "Checkpoint", path="command", cause=cause, remedy="use save, restore or forget"
                )
        return ""

    def save(self, name: str = "") -> str:
        """Saves the current state and returns its name, which is generated if none is given."""
        name = name or f"state_{next(self._next_number)}"
        self._require_save_support()
        if len(self._states) >= CHECKPOINTS.count and name not in self._states:
            raise EngineError(f"{CHECKPOINTS.count} states are saved already; forget one first")
        self._states[name] = self._simulation.engine.run(lambda engine: engine.save_state(), label="save")
        return name

    def restore(self, name: str) -> str:
        """Restores a state; returns why it failed, or an empty string."""
        self._require_save_support()
        state = self._states.get(name)
        if state is None:
            return f"no saved state {name!r}; there is {', '.join(sorted(self._states)) or 'none'}"
        self._simulation.engine.run(lambda engine: engine.restore_state(state), label="restore", edits=True)
        return ""

    def discard(self, name: str) -> None:
        """Deletes a state, if it exists."""
        self._states.pop(name, None)

    def _require_save_support(self) -> None:
        if Capability.SAVE not in self._simulation.engine.capabilities:
            raise EngineError(f"the engine {self._simulation.engine.name!r} cannot save its state")


class RecordingServices:
    """The service that starts and stops the recording of episodes."""

    def __init__(self, simulation: Simulation, folder: Path | None) -> None:
        """Creates the service.

        Args:
            folder: the folder for episodes; None if clients may not record.
        """
        self._simulation = simulation
        self._folder = folder
        self._recordings: RecordingFolder | None = None
        self._lock = threading.Lock()

    def services(self) -> Iterator[ServiceSpec]:
        """Yields the service."""
        yield _service_spec(wire.Record, self.record, FILE)

    def record(self, request: wire.Record.Request) -> wire.Record.Response:
        """Starts or stops a recording.

        Raises:
            EpisodeError: there is no folder for episodes, or see `RecordingFolder`.
        """
        if self._folder is None:
            raise EpisodeError("this simulation has no folder for episodes; start `mindstage serve` with --episodes")
        with self._lock:
            if self._recordings is None:
                from mindstage.episodes.recorder import RecordingFolder

                self._recordings = RecordingFolder(self._simulation, self._folder)
        if request.stop:
            path = self._recordings.stop()
        else:
            path = self._recordings.start(request.name, rate_hz=request.rate_hz or _RECORDING_RATE_HZ)
        return wire.Record.Response(success=True, path=path.name)


class EngineServices:
    """Services and actions of the engine of a simulation."""

    def __init__(self, state_reader: StateReader, diagnostics: DiagnosticsPublisher) -> None:
        self._state_reader = state_reader
        self._simulation = state_reader.simulation
        self._diagnostics = diagnostics
        self._states = CheckpointServices(state_reader.simulation)
        self._session = token_hex(8)
        self._revision_state: tuple[tuple[BodyId, ...], int] = ((), 0)
        self._revision_lock = threading.Lock()

    def services(self) -> Iterator[ServiceSpec]:
        """Yields all services."""
        yield _service_spec(wire.Describe, self.describe, READ)
        yield self._edit_spec(wire.SpawnWorld, self.spawn_world, SPAWN)
        yield _service_spec(wire.LogWorld, self.snapshot_world, READ)
        yield self._edit_spec(wire.ApplyEdit, self.apply_edit, SPAWN)
        yield self._edit_spec(wire.Delete, self.delete)
        yield self._edit_spec(wire.Clear, self.clear)
        yield self._edit_spec(wire.Attach, self.attach)
        yield self._edit_spec(wire.Detach, self.detach)
        yield self._edit_spec(wire.SetPose, self.set_pose)
        yield self._edit_spec(wire.SetPhysics, self.set_physics)
        yield self._edit_spec(wire.SetMaterials, self.set_materials)
        yield self._edit_spec(wire.SetLabel, self.set_label)
        yield _service_spec(wire.Highlight, self.highlight, EDIT)
        yield _service_spec(wire.GetHighlights, self.highlights, READ, quick=True)
        yield _service_spec(wire.Push, self.apply_force, EDIT)
        yield _service_spec(wire.Step, self.step, RUN)
        yield _service_spec(wire.SetSpeed, self.set_speed, EDIT)
        yield _service_spec(wire.GetPoses, self.poses, READ, quick=True)
        yield _service_spec(wire.GetJointPositions, self.joint_positions, READ)
        yield self._edit_spec(wire.SetActuators, self.set_actuators)
        yield _service_spec(wire.SetCommands, self.set_commands, EDIT)
        yield _service_spec(wire.GetActuatorStates, self.actuator_states, READ)
        yield _service_spec(wire.SaveState, self.save_state, EDIT)
        yield self._edit_spec(wire.RestoreState, self.restore_state)
        yield _service_spec(wire.ForgetState, self.discard_state, EDIT)

    def actions(self) -> Iterator[ActionSpec]:
        """Yields all actions."""
        yield ActionSpec(wire.SpawnMap, self.spawn_map, GOAL, name=_service_name(wire.SpawnMap))
        yield ActionSpec(wire.Simulate, self.simulate, GOAL, name=_service_name(wire.Simulate))

    # -- the world -----------------------------------------------------------------------------------------------------

    def describe(self, _: wire.Describe.Request) -> wire.Describe.Response:
        """Returns what the engine is; the engine itself is called, so that a response means that it responds."""
        self._simulation.engine.ping()
        return wire.Describe.Response(
            engine=self._simulation.engine.name,
            abilities=tuple(
                sorted(capability.value for capability in self._simulation.engine.capabilities & _REMOTE_CAPABILITIES)
            ),
            time_s=self._simulation.state.time_s,
            format_version=FORMAT_VERSION,
            session=self._session,
            takes=("geometries",),
        )

    def spawn_world(self, request: wire.SpawnWorld.Request) -> wire.SpawnWorld.Response:
        """Adds a world."""
        report = self._spawn(world_from_json(request.world), request.geometries)
        self._diagnostics.report_spawn("spawn_world", report)
        return wire.SpawnWorld.Response(success=report.ok, report=spawn_report(report))

    def snapshot_world(self, _: wire.LogWorld.Request) -> wire.LogWorld.Response:
        """Returns the current world."""
        return wire.LogWorld.Response(success=True, world=world_to_json(self._simulation.snapshot()))

    def apply_edit(self, request: wire.ApplyEdit.Request) -> wire.ApplyEdit.Response:
        """Makes an edit of any kind; deleted bodies that it restores get the geometry that they had."""
        try:
            inverse = self._simulation.apply(edit_from_json(request.edit)).inverse
        except ValueError as error:  # of actuators
            return wire.ApplyEdit.Response(success=False, refusal=wire.Refusal(text=str(error)))
        if isinstance(inverse, GeometryEdit):
            inverse = msgspec.structs.replace(inverse, geometry={})
        return wire.ApplyEdit.Response(success=True, inverse=edit_to_json(inverse).decode())

    def delete(self, request: wire.Delete.Request) -> wire.Delete.Response:
        """Removes bodies."""
        self._simulation.apply(Delete(tuple(map(BodyId, request.ids))))
        return wire.Delete.Response(success=True)

    def clear(self, _: wire.Clear.Request) -> wire.Clear.Response:
        """Removes everything."""
        self._simulation.clear()
        return wire.Clear.Response(success=True)

    def attach(self, request: wire.Attach.Request) -> wire.Attach.Response:
        """Attaches a body to another one."""
        self._simulation.apply(Attach(BodyId(request.parent), BodyId(request.child)))
        return wire.Attach.Response(success=True)

    def detach(self, request: wire.Detach.Request) -> wire.Detach.Response:
        """Detaches a body."""
        self._simulation.apply(Detach(BodyId(request.child)))
        return wire.Detach.Response(success=True)

    # -- one body ------------------------------------------------------------------------------------------------------

    def set_pose(self, request: wire.SetPose.Request) -> wire.SetPose.Response:
        """Sets the pose of a body."""
        self._simulation.apply(SetPoses({BodyId(request.id): pose_from_message(request.pose)}))
        return wire.SetPose.Response(success=True)

    def set_physics(self, request: wire.SetPhysics.Request) -> wire.SetPhysics.Response:
        """Sets the physics properties of a body."""
        self._simulation.apply(SetPhysics(BodyId(request.id), from_json(request.physics, BodyPhysics)))
        return wire.SetPhysics.Response(success=True)

    def set_materials(self, request: wire.SetMaterials.Request) -> wire.SetMaterials.Response:
        """Sets the materials of a body."""
        materials = from_json(request.materials, tuple[Material, ...])
        self._simulation.apply(SetMaterials(BodyId(request.id), materials))
        return wire.SetMaterials.Response(success=True)

    def set_label(self, request: wire.SetLabel.Request) -> wire.SetLabel.Response:
        """Sets the label of a body."""
        self._simulation.apply(SetLabel(BodyId(request.id), request.label))
        return wire.SetLabel.Response(success=True)

    def highlight(self, request: wire.Highlight.Request) -> wire.Highlight.Response:
        """Highlights bodies in any color, or removes their highlight."""
        color = color_from_message(request.color) if request.highlighted else None
        self._simulation.highlight(map(BodyId, request.ids), color)
        return wire.Highlight.Response(success=True)

    def highlights(self, _: wire.GetHighlights.Request) -> wire.GetHighlights.Response:
        """Returns the highlighted bodies."""
        colors = self._state_reader.state().highlights
        return wire.GetHighlights.Response(
            success=True, ids=tuple(colors), colors=tuple(map(color_message, colors.values()))
        )

    def apply_force(self, request: wire.Push.Request) -> wire.Push.Response:
        """Applies a force throughout the next step."""
        force, point = vector_from_message(request.force), _force_point(request)
        self._simulation.engine.run(
            lambda engine: engine.apply_force(BodyId(request.id), force, point), label="apply force"
        )
        return wire.Push.Response(success=True)

    # -- time and state ------------------------------------------------------------------------------------------------

    def step(self, request: wire.Step.Request) -> wire.Step.Response:
        """Advances the simulation in one step, in which the given forces act throughout."""
        left_s = STEP_DURATION.check(request.duration_s)
        forces = [(BodyId(each.id), vector_from_message(each.force), _force_point(each)) for each in request.forces]

        def step(engine: Engine) -> float:
            while forces:
                engine.apply_force(*forces.pop())
            step_for = getattr(engine, "step_for", None)  # `engine` may stand for another one
            if step_for is not None:
                return float(step_for(left_s, wall_s=_SLICE_WALL_S))
            engine.step(left_s)
            return 0.0

        timeout_s = self._simulation.timeout_s * (1.0 + 6.0 * left_s)
        is_first = True
        while is_first or left_s > 0.0:
            left_s = self._simulation.engine.run(step, label="step", timeout_s=timeout_s)
            is_first = False
        snapshot = self._simulation.state
        response = wire.Step.Response(success=True, time_s=snapshot.time_s)
        return msgspec.structs.replace(response, **self._pose_bytes(snapshot)) if request.packed else response

    def set_speed(self, request: wire.SetSpeed.Request) -> wire.SetSpeed.Response:
        """Sets the real-time factor, or pauses the simulation."""
        snapshot = self._simulation.state
        before = snapshot.speed if snapshot.playing else 0.0
        if SPEED.check(request.speed):
            self._simulation.play(speed=request.speed)
            self._simulation.engine.ping()  # so that the snapshot has the new speed before the response
        else:
            self._simulation.pause()
        return wire.SetSpeed.Response(success=True, before=before)

    def poses(self, request: wire.GetPoses.Request) -> wire.GetPoses.Response:
        """Returns the poses of all bodies."""
        snapshot = self._state_reader.state()
        revision = self._revision(snapshot)
        ids = () if request.known == revision else snapshot.ids
        response = wire.GetPoses.Response(success=True, time_s=snapshot.time_s, ids=ids, revision=revision)
        if request.packed:
            return msgspec.structs.replace(response, **self._pose_bytes(snapshot))
        return msgspec.structs.replace(response, poses=pose_array_messages(snapshot.poses))

    def joint_positions(self, _: wire.GetJointPositions.Request) -> wire.GetJointPositions.Response:
        """Returns the displacements of all joints."""
        if Capability.JOINTS not in self._simulation.engine.capabilities:
            raise EngineError(f"the engine {self._simulation.engine.name!r} has no joint positions")
        positions = self._simulation.engine.run(lambda engine: engine.joint_positions(), label="joint positions")
        return wire.GetJointPositions.Response(
            success=True, joints=tuple(_joint_message(id, numbers) for id, numbers in positions.items())
        )

    def set_actuators(self, request: wire.SetActuators.Request) -> wire.SetActuators.Response:
        """Adds actuators."""
        actuators = from_json(request.actuators, tuple[Actuator, ...])
        bodies = tuple(map(BodyId, request.without_weight))
        try:
            self._simulation.apply(SetActuators(actuators, bodies))
        except ValueError as error:
            return wire.SetActuators.Response(success=False, refusal=wire.Refusal(text=str(error)))
        return wire.SetActuators.Response(success=True)

    def set_commands(self, request: wire.SetCommands.Request) -> wire.SetCommands.Response:
        """Sets the commands of actuators."""
        try:
            commands = dict(zip(request.names, request.commands, strict=True))
            self._simulation.engine.run(lambda engine: engine.set_commands(commands), label="set commands")
        except (KeyError, ValueError) as error:
            return wire.SetCommands.Response(success=False, refusal=wire.Refusal(text=str(error.args[0])))
        return wire.SetCommands.Response(success=True)

    def actuator_states(self, _: wire.GetActuatorStates.Request) -> wire.GetActuatorStates.Response:
        """Returns the state of each actuator."""
        states = self._simulation.engine.run(lambda engine: engine.actuator_states(), label="actuator states")
        return wire.GetActuatorStates.Response(
            success=True,
            actuators=tuple(
                wire.ActuatorState(
                    name=name, position=each.position, velocity=each.velocity, effort=each.effort, command=each.command
                )
                for name, each in states.items()
            ),
        )

    def save_state(self, _: wire.SaveState.Request) -> wire.SaveState.Response:
        """Saves the state in this process."""
        return wire.SaveState.Response(success=True, handle=self._states.save())

    def restore_state(self, request: wire.RestoreState.Request) -> wire.RestoreState.Response:
        """Restores a state."""
        reason = self._states.restore(request.handle)
        if reason:
            raise EngineError(reason)
        return wire.RestoreState.Response(success=True)

    def discard_state(self, request: wire.ForgetState.Request) -> wire.ForgetState.Response:
        """Deletes a state."""
        self._states.discard(request.handle)
        return wire.ForgetState.Response(success=True)

    # -- actions -------------------------------------------------------------------------------------------------------

    def spawn_map(self, goal: wire.SpawnMap.Goal, context: GoalContext) -> wire.SpawnMap.Result:
        """Spawns a world; if the goal is canceled meanwhile, its bodies are deleted again."""

        def feedback(phase: str, done: int) -> wire.SpawnMap.Feedback:
            return wire.SpawnMap.Feedback(phase=phase, done=done, total=total)

        total = 0
        context.check(lambda: feedback("reading", 0))
        world = world_from_json(goal.world)
        total = len(world.bodies) + len(world.joints) + len(world.attachments)
        before = set(self._state_reader.state().ids)
        with context.sending_feedback(lambda: feedback("spawning", 0)):
            report = self._spawn(world, goal.geometries)
        if context.cancelled:
            present = set(self._state_reader.state().ids)
            spawned = (body.id for body in world.bodies if body.id in present and body.id not in before)
            self._simulation.apply(Delete(tuple(spawned)))
            raise GoalCanceledError
        context.send_feedback(feedback("spawned", report.bodies + report.joints + report.attachments))
        self._diagnostics.report_spawn("spawn_map", report)
        rebuild_s = report.expected_rebuild_s
        return wire.SpawnMap.Result(success=report.ok, report=spawn_report(report), expected_rebuild_s=rebuild_s)

    def simulate(self, goal: wire.Simulate.Goal, context: GoalContext) -> wire.Simulate.Result:
        """Advances the simulation, with feedback."""
        duration_s = STEP_DURATION.check(goal.duration_s)
        elapsed_s = 0.0

        def feedback() -> wire.Simulate.Feedback:
            return wire.Simulate.Feedback(elapsed_s=elapsed_s, remaining_s=duration_s - elapsed_s)

        while elapsed_s < duration_s:
            context.check(feedback)
            chunk_s = min(_STEP_CHUNK_S, duration_s - elapsed_s)
            self._simulation.step(chunk_s)
            elapsed_s = elapsed_s + chunk_s if duration_s - elapsed_s > _STEP_CHUNK_S else duration_s
        return wire.Simulate.Result(success=True, time_s=self._simulation.state.time_s)

    def _edit_spec(self, type: type[Service], handler: Callable[[Any], Any], policy: Policy = EDIT) -> ServiceSpec:
        def edit(request: Any) -> Any:
            response = handler(request)
            return msgspec.structs.replace(response, expected_rebuild_s=self._simulation.state.expected_rebuild_s)

        return _service_spec(type, edit, policy)

    def _spawn(self, world: World, geometry: str) -> SpawnReport:
        """Spawns a world with the geometries in the request, or else with those of the simulation."""
        return (
            self._simulation.spawn(world, geometry=geometry_from_json(geometry))
            if geometry
            else self._simulation.spawn(world)
        )

    def _revision(self, snapshot: StateSnapshot) -> int:
        """Returns a number that changes whenever bodies are added or removed."""
        with self._revision_lock:
            ids, number = self._revision_state
            if ids is not snapshot.ids:
                self._revision_state = snapshot.ids, number + 1
            return self._revision_state[1]

    def _pose_bytes(self, snapshot: StateSnapshot) -> dict[str, Any]:
        return {"revision": self._revision(snapshot), "rows": snapshot.poses.astype("<f8").tobytes()}


def spawn_report(report: SpawnReport) -> wire.SpawnReport:
    """Converts a report to a message."""
    fields = msgspec.to_builtins(report)
    for name in ("moved", "rest_checked_s", "expected_rebuild_s"):  # observed after the spawn
        del fields[name]
    return msgspec.convert(fields, wire.SpawnReport)


def _service_spec(type: type[Service], handler: Callable[[Any], Any], policy: Policy, **options: Any) -> ServiceSpec:
    return ServiceSpec(type, handler, policy, name=_service_name(type), **options)


def _service_name(type: type[Service] | type[Action]) -> str:
    return f"mindstage/{snake_case(type)}"


def _joint_message(id: str, numbers: tuple[float, ...]) -> wire.JointPosition:
    x, y, z, twist, swing2, swing1 = numbers
    return wire.JointPosition(id=id, x=x, y=y, z=z, twist=twist, swing2=swing2, swing1=swing1)


def _force_point(request: wire.Push.Request | wire.Force) -> Vector | None:
    return point_from_message(request.point) if request.at_point else None
