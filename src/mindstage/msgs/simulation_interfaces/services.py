"""The services and the action of simulation_interfaces."""
# ruff: noqa: D106 - Request and Response say what they are

from __future__ import annotations

from typing import ClassVar

from mindstage.msgs.geometry_msgs import PoseStamped
from mindstage.msgs.message import Action, Message, Service
from mindstage.msgs.primitives import Bool, String, Uint8, Uint8Code, Uint64
from mindstage.msgs.simulation_interfaces import messages
from mindstage.msgs.simulation_interfaces.messages import (
    Bounds,
    EntityFilters,
    EntityInfo,
    EntityState,
    NamedPose,
    Resource,
    Result,
    SimulationState,
    SimulatorFeatures,
    Spawnable,
    SpawnCode,
    SpawnResult,
    TagsFilter,
    WorldResource,
)

__all__ = [
    "AvailableWorldsCode",
    "DeleteEntity",
    "GetAvailableWorlds",
    "GetCurrentWorld",
    "GetEntities",
    "GetEntitiesStates",
    "GetEntityBounds",
    "GetEntityInfo",
    "GetEntityState",
    "GetNamedPoseBounds",
    "GetNamedPoses",
    "GetSimulationState",
    "GetSimulatorFeatures",
    "GetSpawnables",
    "LoadWorld",
    "LoadWorldCode",
    "ResetScope",
    "ResetSimulation",
    "SetEntityInfo",
    "SetEntityState",
    "SetEntityStateCode",
    "SetSimulationState",
    "SetSimulationStateCode",
    "SimulateSteps",
    "SpawnEntities",
    "SpawnEntitiesCode",
    "SpawnEntity",
    "StepSimulation",
    "UnloadWorld",
    "UnloadWorldCode",
]


class GetSimulatorFeatures(Service):
    """What this simulator can do."""

    class Request(Message, frozen=True):
        pass

    class Response(Message, frozen=True):
        features: SimulatorFeatures = SimulatorFeatures()


class GetSpawnables(Service):
    """What can be spawned."""

    class Request(Message, frozen=True):
        sources: tuple[String, ...] = ()

    class Response(Message, frozen=True):
        result: Result = Result()
        spawnables: tuple[Spawnable, ...] = ()


class SpawnEntity(Service):
    """Spawns one entity; since 2.1, `SpawnEntities` is to be used in its place."""

    class Request(Message, frozen=True):
        name: String = ""
        allow_renaming: Bool = False
        entity_resource: Resource = Resource()
        entity_namespace: String = ""
        initial_pose: PoseStamped = PoseStamped()

    class Response(Message, frozen=True):
        constants: ClassVar = (SpawnCode,)

        result: Result = Result()
        entity_name: String = ""


class SpawnEntitiesCode(Uint8Code):
    """What more can go wrong."""

    ENTITIES_SPAWN_FAILED = 150


class SpawnEntities(Service):
    """Spawns entities; the results stand in the order of the requests."""

    class Request(Message, frozen=True):
        spawn_requests: tuple[messages.SpawnEntity, ...] = ()

    class Response(Message, frozen=True):
        constants: ClassVar = (SpawnEntitiesCode,)

        result: Result = Result()
        results: tuple[SpawnResult, ...] = ()


class DeleteEntity(Service):
    """Takes an entity away."""

    class Request(Message, frozen=True):
        entity: String = ""

    class Response(Message, frozen=True):
        result: Result = Result()


class GetEntities(Service):
    """The names of entities."""

    class Request(Message, frozen=True):
        filters: EntityFilters = EntityFilters()

    class Response(Message, frozen=True):
        result: Result = Result()
        entities: tuple[String, ...] = ()


class GetEntitiesStates(Service):
    """Entities and where they are; both lists run in parallel."""

    class Request(Message, frozen=True):
        filters: EntityFilters = EntityFilters()

    class Response(Message, frozen=True):
        result: Result = Result()
        entities: tuple[String, ...] = ()
        states: tuple[EntityState, ...] = ()


class GetEntityState(Service):
    """Where an entity is and how it moves."""

    class Request(Message, frozen=True):
        entity: String = ""

    class Response(Message, frozen=True):
        result: Result = Result()
        state: EntityState = EntityState()


class SetEntityStateCode(Uint8Code):
    """What more can go wrong."""

    INVALID_POSE = 101


class SetEntityState(Service):
    """Puts an entity somewhere else, or in motion; only what is flagged is set."""

    class Request(Message, frozen=True):
        entity: String = ""
        state: EntityState = EntityState()
        set_pose: Bool = False
        set_twist: Bool = False
        set_acceleration: Bool = False

    class Response(Message, frozen=True):
        constants: ClassVar = (SetEntityStateCode,)

        result: Result = Result()


class GetEntityInfo(Service):
    """What an entity is."""

    class Request(Message, frozen=True):
        entity: String = ""

    class Response(Message, frozen=True):
        result: Result = Result()
        info: EntityInfo = EntityInfo()


class SetEntityInfo(Service):
    """Says what an entity is."""

    class Request(Message, frozen=True):
        entity: String = ""
        info: EntityInfo = EntityInfo()

    class Response(Message, frozen=True):
        result: Result = Result()


class GetEntityBounds(Service):
    """How much room an entity takes."""

    class Request(Message, frozen=True):
        entity: String = ""

    class Response(Message, frozen=True):
        result: Result = Result()
        bounds: Bounds = Bounds()


class GetNamedPoses(Service):
    """Places that have a name."""

    class Request(Message, frozen=True):
        tags: TagsFilter = TagsFilter()

    class Response(Message, frozen=True):
        result: Result = Result()
        poses: tuple[NamedPose, ...] = ()


class GetNamedPoseBounds(Service):
    """How much room there is at a place that has a name."""

    class Request(Message, frozen=True):
        name: String = ""

    class Response(Message, frozen=True):
        result: Result = Result()
        bounds: Bounds = Bounds()


class GetSimulationState(Service):
    """Whether the simulation runs."""

    class Request(Message, frozen=True):
        pass

    class Response(Message, frozen=True):
        state: SimulationState = SimulationState()
        result: Result = Result()


class SetSimulationStateCode(Uint8Code):
    """What more can go wrong."""

    ALREADY_IN_TARGET_STATE = 101
    STATE_TRANSITION_ERROR = 102
    INCORRECT_TRANSITION = 103


class SetSimulationState(Service):
    """Plays, pauses, stops or quits."""

    class Request(Message, frozen=True):
        state: SimulationState = SimulationState()

    class Response(Message, frozen=True):
        constants: ClassVar = (SetSimulationStateCode,)

        result: Result = Result()


class StepSimulation(Service):
    """Runs so many steps of a paused simulation, and replies when they are done."""

    class Request(Message, frozen=True):
        steps: Uint64 = 1

    class Response(Message, frozen=True):
        result: Result = Result()


class ResetScope(Uint8Code):
    """What is to be reset; times, states and spawned entities can be added up."""

    SCOPE_DEFAULT = 0
    SCOPE_TIME = 1
    SCOPE_STATE = 2
    SCOPE_SPAWNED = 4
    SCOPE_ALL = 255


class ResetSimulation(Service):
    """Goes back to the start."""

    class Request(Message, frozen=True):
        constants: ClassVar = (ResetScope,)

        scope: Uint8 = ResetScope.SCOPE_DEFAULT

    class Response(Message, frozen=True):
        result: Result = Result()


class LoadWorldCode(Uint8Code):
    """What more can go wrong."""

    UNSUPPORTED_FORMAT = 101
    NO_RESOURCE = 102
    RESOURCE_PARSE_ERROR = 103
    MISSING_ASSETS = 104
    UNSUPPORTED_ASSETS = 105
    UNSUPPORTED_ELEMENTS = 106


class LoadWorld(Service):
    """Brings a world in the place of what is there."""

    class Request(Message, frozen=True):
        world_resource: Resource = Resource()
        fail_on_unsupported_element: Bool = False
        ignore_missing_or_unsupported_assets: Bool = False

    class Response(Message, frozen=True):
        constants: ClassVar = (LoadWorldCode,)

        result: Result = Result()
        world: WorldResource = WorldResource()


class UnloadWorldCode(Uint8Code):
    """What more can go wrong."""

    NO_WORLD_LOADED = 101


class UnloadWorld(Service):
    """Takes everything away."""

    class Request(Message, frozen=True):
        pass

    class Response(Message, frozen=True):
        constants: ClassVar = (UnloadWorldCode,)

        result: Result = Result()


class GetCurrentWorld(Service):
    """Which world is loaded."""

    class Request(Message, frozen=True):
        pass

    class Response(Message, frozen=True):
        result: Result = Result()
        world: WorldResource = WorldResource()


class AvailableWorldsCode(Uint8Code):
    """What more can go wrong."""

    DEFAULT_SOURCES_FAILED = 101


class GetAvailableWorlds(Service):
    """Which worlds can be loaded."""

    class Request(Message, frozen=True):
        additional_sources: tuple[String, ...] = ()
        filter: TagsFilter = TagsFilter()
        offline_only: Bool = False
        continue_on_error: Bool = False

    class Response(Message, frozen=True):
        constants: ClassVar = (AvailableWorldsCode,)

        result: Result = Result()
        worlds: tuple[WorldResource, ...] = ()


class SimulateSteps(Action):
    """Runs so many steps of a paused simulation, and tells how far it is."""

    class Goal(Message, frozen=True):
        steps: Uint64 = 0

    class Result(Message, frozen=True):
        result: messages.Result = messages.Result()

    class Feedback(Message, frozen=True):
        completed_steps: Uint64 = 0
        remaining_steps: Uint64 = 0
