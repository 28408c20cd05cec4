"""Scene description: worlds as engine-independent values, frame conversions, and the comparison of worlds.

A module is imported when one of its names is first used: questions about classes need no NumPy.
"""

from typing import TYPE_CHECKING

from mindstage.lazy_names import lazy_names

if TYPE_CHECKING:
    from mindstage.scene.blank_node_matching import Statement
    from mindstage.scene.geometry import (
        NO_GEOMETRY,
        AttachedLight,
        BodyGeometry,
        CollisionShape,
        CollisionShapeType,
        GeometryMap,
        GeometrySource,
        PbrMaterial,
        SupportSurface,
        VisualMesh,
    )
    from mindstage.scene.world_diff import MECHANICAL_KINDS, ChangeKind, FieldChange, WorldDiff, diff
    from mindstage.scene.world_model import (
        IDENTITY,
        AngularLimits,
        Attachment,
        AxisMotion,
        BlankNode,
        Body,
        BodyId,
        BodyPhysics,
        Color,
        FactValue,
        Iri,
        IriRef,
        Joint,
        JointMimic,
        Light,
        LightType,
        LinearLimits,
        Literal,
        Material,
        Mobility,
        NamedResource,
        Pose,
        PoseLike,
        PrimitiveShape,
        PrimitiveType,
        PropertyAssertion,
        Quaternion,
        SoftLimit,
        Tag,
        Vector,
        World,
        as_pose,
    )

__all__ = [
    "IDENTITY",
    "MECHANICAL_KINDS",
    "NO_GEOMETRY",
    "AngularLimits",
    "AttachedLight",
    "Attachment",
    "AxisMotion",
    "BlankNode",
    "Body",
    "BodyGeometry",
    "BodyId",
    "BodyPhysics",
    "ChangeKind",
    "CollisionShape",
    "CollisionShapeType",
    "Color",
    "FactValue",
    "FieldChange",
    "GeometryMap",
    "GeometrySource",
    "Iri",
    "IriRef",
    "Joint",
    "JointMimic",
    "Light",
    "LightType",
    "LinearLimits",
    "Literal",
    "Material",
    "Mobility",
    "NamedResource",
    "PbrMaterial",
    "Pose",
    "PoseLike",
    "PrimitiveShape",
    "PrimitiveType",
    "PropertyAssertion",
    "Quaternion",
    "SoftLimit",
    "Statement",
    "SupportSurface",
    "Tag",
    "Vector",
    "VisualMesh",
    "World",
    "WorldDiff",
    "as_pose",
    "diff",
]

_MODULES = ("world_model", "geometry", "blank_node_matching", "world_diff")
"""The modules of these names; those that most programs need first."""

__getattr__, __dir__ = lazy_names(__name__, [f"{__name__}.{each}" for each in _MODULES], packages=["edits"])
