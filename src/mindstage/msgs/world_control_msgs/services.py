"""The services of world_control_msgs: everything that Unreal's plugin can be asked to do."""
# ruff: noqa: D106 - Request and Response say what they are

from __future__ import annotations

from typing import ClassVar

from mindstage.msgs.geometry_msgs import Pose
from mindstage.msgs.message import Message, Service
from mindstage.msgs.primitives import Bool, Float32, String, Uint8Code
from mindstage.msgs.world_control_msgs.messages import (
    ConstraintDescription,
    ModelDescription,
    PhysicsProperties,
    RelationDescription,
    Tag,
)

__all__ = [
    "AttachModelToParent",
    "Checkpoint",
    "ColourCode",
    "DeleteAll",
    "DeleteModel",
    "GetModelPose",
    "GetModelSocketPose",
    "HighlightModel",
    "MoveObject",
    "ObjectToObjectState",
    "ResetLevel",
    "SetMaterial",
    "SetModelPose",
    "SetPhysicsProperties",
    "SpawnModel",
    "SpawnPhysicsConstraint",
    "SpawnProMesh",
    "SpawnSemanticMap",
]


class SpawnSemanticMap(Service):
    """Spawns models, then constraints, then relations; only a reply without failures is a success."""

    class Request(Message, frozen=True):
        models: tuple[ModelDescription, ...] = ()
        constraints: tuple[ConstraintDescription, ...] = ()
        relations: tuple[RelationDescription, ...] = ()

    class Response(Message, frozen=True):
        success: Bool = False
        failed_model_ids: tuple[String, ...] = ()
        failed_constraint_ids: tuple[String, ...] = ()
        failed_relations: tuple[RelationDescription, ...] = ()


class SpawnModel(Service):
    """Spawns one model; the reply holds the id, which is made if none was given."""

    class Request(Message, frozen=True):
        name: String = ""
        pose: Pose = Pose()
        id: String = ""
        tags: tuple[Tag, ...] = ()
        path: String = ""
        actor_label: String = ""
        override_name: String = ""
        physics_properties: PhysicsProperties = PhysicsProperties()
        material_names: tuple[String, ...] = ()
        material_paths: tuple[String, ...] = ()
        parent_id: String = ""
        spawn_collision_check: Bool = False

    class Response(Message, frozen=True):
        ID_TAKEN: ClassVar = "1"
        OBSTRUCTED: ClassVar = "2"
        spellings: ClassVar = {"Name": "name"}

        id: String = ""
        name: String = ""
        etype: String = ""
        """Empty, `ID_TAKEN` or `OBSTRUCTED`."""
        success: Bool = False


class SpawnProMesh(Service):
    """Spawns a box of that size."""

    class Request(Message, frozen=True):
        height: Float32 = 0.0
        """Along z [m]."""
        width: Float32 = 0.0
        """Along y [m]."""
        depth: Float32 = 0.0
        """Along x [m]."""
        pose: Pose = Pose()
        id: String = ""
        tags: tuple[Tag, ...] = ()
        actor_label: String = ""
        physics_properties: PhysicsProperties = PhysicsProperties()
        parent_id: String = ""

    class Response(Message, frozen=True):
        spellings: ClassVar = {"Name": "name"}

        id: String = ""
        name: String = ""
        success: Bool = False


class SpawnPhysicsConstraint(Service):
    """Joins two models."""

    class Request(Message, frozen=True):
        constraint_description: ConstraintDescription = ConstraintDescription()

    class Response(Message, frozen=True):
        success: Bool = False


class AttachModelToParent(Service):
    """Hangs the child on the parent; both stay where they are."""

    class Request(Message, frozen=True):
        parent_id: String = ""
        child_id: String = ""

    class Response(Message, frozen=True):
        success: Bool = False


class DeleteModel(Service):
    """Takes a model away."""

    class Request(Message, frozen=True):
        id: String = ""

    class Response(Message, frozen=True):
        success: Bool = False


class DeleteAll(Service):
    """Takes away all models that have such a tag."""

    class Request(Message, frozen=True):
        type_to_delete: String = ""
        key_to_delete: String = ""
        value_to_delete: String = ""
        ignore_value: Bool = False
        """Any value will do."""

    class Response(Message, frozen=True):
        success: Bool = False


class SetModelPose(Service):
    """Puts a model somewhere else."""

    class Request(Message, frozen=True):
        id: String = ""
        pose: Pose = Pose()

    class Response(Message, frozen=True):
        success: Bool = False


class GetModelPose(Service):
    """Where a model is."""

    class Request(Message, frozen=True):
        id: String = ""

    class Response(Message, frozen=True):
        pose: Pose = Pose()
        success: Bool = False


class GetModelSocketPose(Service):
    """Where a named place on a model is."""

    class Request(Message, frozen=True):
        id: String = ""
        socket: String = ""

    class Response(Message, frozen=True):
        pose: Pose = Pose()
        success: Bool = False


class SetPhysicsProperties(Service):
    """Changes how a model takes part in the physics."""

    class Request(Message, frozen=True):
        id: String = ""
        physics_properties: PhysicsProperties = PhysicsProperties()

    class Response(Message, frozen=True):
        success: Bool = False


class SetMaterial(Service):
    """Changes a model's surface; the plugin offers it as `change_material`."""

    class Request(Message, frozen=True):
        id: String = ""
        material_names: tuple[String, ...] = ()
        material_paths: tuple[String, ...] = ()

    class Response(Message, frozen=True):
        success: Bool = False


class ColourCode(Uint8Code):
    """The colours in which a model can be outlined."""

    NONE = 0
    BLACK = 1
    RED = 2
    BLUE = 3
    GREEN = 4
    YELLOW = 5


class HighlightModel(Service):
    """Outlines a model, or ends that; the plugin offers it as `highlight_models`."""

    class Request(Message, frozen=True):
        id: String = ""
        color: ColourCode = ColourCode.NONE

    class Response(Message, frozen=True):
        success: Bool = False


class ObjectToObjectState(Service):
    """How one model stands to another, in a word."""

    class Request(Message, frozen=True):
        source_object_id: String = ""
        other_object_id: String = ""

    class Response(Message, frozen=True):
        state: String = ""
        success: Bool = False


class Checkpoint(Service):
    """Keeps a state, or brings one back."""

    class Request(Message, frozen=True):
        command: String = ""
        args: String = ""

    class Response(Message, frozen=True):
        success: Bool = False


class ResetLevel(Service):
    """Starts the level anew."""

    class Request(Message, frozen=True):
        id: String = ""

    class Response(Message, frozen=True):
        success: Bool = False


class MoveObject(Service):
    """Puts the actor of that name somewhere else."""

    class Request(Message, frozen=True):
        spellings: ClassVar = {"name": "Name"}

        Name: String = ""
        pose: Pose = Pose()

    class Response(Message, frozen=True):
        success: Bool = False
