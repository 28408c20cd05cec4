"""The messages of simulation_interfaces: entities, worlds, bounds, and how a call ended."""

from __future__ import annotations

from typing import ClassVar

from mindstage.msgs.geometry_msgs import Accel, Pose, PoseStamped, Twist, Vector3
from mindstage.msgs.message import Message
from mindstage.msgs.primitives import Bool, String, Uint8, Uint8Code, Uint16
from mindstage.msgs.std_msgs import Header

__all__ = [
    "Bounds",
    "BoundsType",
    "Category",
    "EntityCategory",
    "EntityFilters",
    "EntityInfo",
    "EntityState",
    "Feature",
    "FilterMode",
    "NamedPose",
    "Resource",
    "Result",
    "ResultCode",
    "SimulationState",
    "SimulatorFeatures",
    "SpawnCode",
    "SpawnEntity",
    "SpawnResult",
    "Spawnable",
    "StateCode",
    "TagsFilter",
    "WorldResource",
]


class ResultCode(Uint8Code):
    """How a call ended; codes above 100 belong to the service that was called."""

    RESULT_FEATURE_UNSUPPORTED = 0
    RESULT_OK = 1
    RESULT_NOT_FOUND = 2
    RESULT_INCORRECT_STATE = 3
    RESULT_OPERATION_FAILED = 4


class Result(Message, frozen=True):
    """How a call ended, and why."""

    constants: ClassVar = (ResultCode,)

    result: Uint8 = ResultCode.RESULT_FEATURE_UNSUPPORTED
    """A `ResultCode`, or a code of the service itself."""
    error_message: String = ""


class Feature(Uint8Code):
    """What a simulator can do."""

    SPAWNING = 0
    DELETING = 1
    NAMED_POSES = 2
    POSE_BOUNDS = 3
    ENTITY_TAGS = 4
    ENTITY_BOUNDS = 5
    ENTITY_BOUNDS_BOX = 6
    ENTITY_BOUNDS_CONVEX = 7
    ENTITY_CATEGORIES = 8
    SPAWNING_RESOURCE_STRING = 9
    ENTITY_STATE_GETTING = 10
    ENTITY_STATE_SETTING = 11
    ENTITY_INFO_GETTING = 12
    ENTITY_INFO_SETTING = 13
    SPAWNABLES = 14
    SIMULATION_RESET = 20
    SIMULATION_RESET_TIME = 21
    SIMULATION_RESET_STATE = 22
    SIMULATION_RESET_SPAWNED = 23
    SIMULATION_STATE_GETTING = 24
    SIMULATION_STATE_SETTING = 25
    SIMULATION_STATE_PAUSE = 26
    STEP_SIMULATION_SINGLE = 31
    STEP_SIMULATION_MULTIPLE = 32
    STEP_SIMULATION_ACTION = 33
    WORLD_LOADING = 40
    WORLD_RESOURCE_STRING = 41
    WORLD_TAGS = 42
    WORLD_UNLOADING = 43
    WORLD_INFO_GETTING = 44
    AVAILABLE_WORLDS = 45
    SPAWNING_ENTITIES = 50


class SimulatorFeatures(Message, frozen=True):
    """What this simulator can do; a later version of the package may know more features."""

    constants: ClassVar = (Feature,)

    features: tuple[Uint16, ...] = ()
    spawn_formats: tuple[String, ...] = ()
    custom_info: String = ""


class BoundsType(Uint8Code):
    """What the points of bounds mean."""

    TYPE_EMPTY = 0
    TYPE_BOX = 1
    """Two: the upper and the lower corner."""
    TYPE_CONVEX_HULL = 2
    """Three or more."""
    TYPE_SPHERE = 3
    """Two: the centre, and the radius as the second one's x."""


class Bounds(Message, frozen=True):
    """A space, seen from the entity it belongs to."""

    type: BoundsType = BoundsType.TYPE_EMPTY
    points: tuple[Vector3, ...] = ()


class Category(Uint8Code):
    """What kind of thing an entity is."""

    CATEGORY_UNKNOWN = 0
    CATEGORY_OBJECT = 1
    CATEGORY_ROBOT = 2
    CATEGORY_HUMAN = 3
    CATEGORY_DYNAMIC_OBJECT = 4
    CATEGORY_STATIC_OBJECT = 5


class EntityCategory(Message, frozen=True):
    """What kind of thing an entity is."""

    category: Category = Category.CATEGORY_UNKNOWN


class EntityInfo(Message, frozen=True):
    """What an entity is."""

    category: EntityCategory = EntityCategory()
    description: String = ""
    tags: tuple[String, ...] = ()


class EntityState(Message, frozen=True):
    """Where an entity is and how it moves, in the header's frame; without one, in the world's."""

    header: Header = Header()
    pose: Pose = Pose()
    twist: Twist = Twist()
    acceleration: Accel = Accel()


class FilterMode(Uint8Code):
    """How many of the tags must be there."""

    FILTER_MODE_ANY = 0
    FILTER_MODE_ALL = 1


class TagsFilter(Message, frozen=True):
    """Only what has such tags; no tags, no filter."""

    tags: tuple[String, ...] = ()
    filter_mode: FilterMode = FilterMode.FILTER_MODE_ANY


class EntityFilters(Message, frozen=True):
    """Only entities of which all of this is true; what is empty filters nothing."""

    filter: String = ""
    """A POSIX extended regular expression for the name."""
    categories: tuple[EntityCategory, ...] = ()
    tags: TagsFilter = TagsFilter()
    bounds: Bounds = Bounds()


class NamedPose(Message, frozen=True):
    """A place that has a name."""

    name: String = ""
    description: String = ""
    tags: tuple[String, ...] = ()
    pose: Pose = Pose()


class Resource(Message, frozen=True):
    """Something to load: by its address, else by its text."""

    uri: String = ""
    resource_string: String = ""


class Spawnable(Message, frozen=True):
    """Something that can be spawned."""

    entity_resource: Resource = Resource()
    description: String = ""
    spawn_bounds: Bounds = Bounds()


class SpawnCode(Uint8Code):
    """Why an entity was not spawned."""

    NAME_NOT_UNIQUE = 101
    NAME_INVALID = 102
    UNSUPPORTED_FORMAT = 103
    NO_RESOURCE = 104
    NAMESPACE_INVALID = 105
    RESOURCE_PARSE_ERROR = 106
    MISSING_ASSETS = 107
    UNSUPPORTED_ASSETS = 108
    INVALID_POSE = 109


class SpawnEntity(Message, frozen=True):
    """One entity to be spawned."""

    name: String = ""
    allow_renaming: Bool = False
    entity_resource: Resource = Resource()
    entity_namespace: String = ""
    initial_pose: PoseStamped = PoseStamped()


class SpawnResult(Message, frozen=True):
    """What became of one entity that was to be spawned."""

    constants: ClassVar = (SpawnCode,)

    result: Result = Result()
    entity_name: String = ""


class StateCode(Uint8Code):
    """Whether the simulation runs."""

    STATE_STOPPED = 0
    STATE_PLAYING = 1
    STATE_PAUSED = 2
    STATE_QUITTING = 3
    STATE_NO_WORLD = 4
    STATE_LOADING_WORLD = 5


class SimulationState(Message, frozen=True):
    """Whether the simulation runs."""

    state: StateCode = StateCode.STATE_STOPPED


class WorldResource(Message, frozen=True):
    """A world that can be loaded."""

    name: String = ""
    world_resource: Resource = Resource()
    description: String = ""
    tags: tuple[String, ...] = ()
