"""The questions: each declared once, for Python, shell and whatever else asks.

A module is imported when one of its names is first used: a question needs none of the others.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mindstage.knowledge.queries.individuals import (
        HandleOf,
        IndividualDescription,
        JointSummary,
        MapCounts,
        PartOf,
        PoseRow,
        analyse,
        handle_of,
        part_of,
        pose_of,
        what_is,
    )
    from mindstage.knowledge.queries.inventory import (
        ClassCount,
        LargerRow,
        Measure,
        MisplacedRow,
        SimilarRow,
        StateRow,
        how_many,
        larger_than,
        misplaced,
        similar_to,
        states,
    )
    from mindstage.knowledge.queries.maps import (
        InstanceOfClass,
        MapDifference,
        MapEquality,
        MapInfo,
        MapMember,
        differences,
        everything_in_map,
        identical_maps,
        individual_of_class,
        maps,
    )
    from mindstage.knowledge.queries.navigation import (
        FloorPathRow,
        ReachabilityRow,
        RoomBasis,
        RoomRow,
        in_room,
        path,
        reachable,
    )
    from mindstage.knowledge.queries.proximity import (
        BetweenRow,
        DirectionRow,
        DistanceRow,
        NeighborRow,
        ReferenceFrame,
        direction_of,
        distance,
        is_between,
        nearest,
    )
    from mindstage.knowledge.queries.spatial import JointOpenness, OpenState, SpatialRelationRow, openings, where_is
    from mindstage.knowledge.queries.storage import (
        ActionDevice,
        ActionDeviceInMap,
        StoragePlace,
        StoragePlaceInMap,
        device_for_action,
        device_for_action_in_environment,
        storage_place,
        storage_place_in_environment,
    )
    from mindstage.knowledge.queries.taxonomy import (
        ClassRestrictionRow,
        SiblingClasses,
        SubclassRelation,
        class_properties,
        siblings,
        subclass_of,
    )
    from mindstage.knowledge.queries.visibility import (
        FitRow,
        FreePlaceRow,
        LiquidBasis,
        LiquidContainerRow,
        PlaceRelation,
        VisibilityRow,
        can_hold_liquid,
        fits,
        free_place,
        visible_from,
    )
    from mindstage.knowledge.questions import (
        AnswerRow,
        Answers,
        ClassName,
        IndividualName,
        MapName,
        MissingKnowledge,
        PropertyName,
        Question,
        QuestionArgument,
        ValueName,
        answers_to_builtins,
        cell_text,
        get_question,
        list_questions,
        question,
        subject_column,
    )

__all__ = [
    "ActionDevice",
    "ActionDeviceInMap",
    "AnswerRow",
    "Answers",
    "BetweenRow",
    "ClassCount",
    "ClassName",
    "ClassRestrictionRow",
    "DirectionRow",
    "DistanceRow",
    "FitRow",
    "FloorPathRow",
    "FreePlaceRow",
    "HandleOf",
    "IndividualDescription",
    "IndividualName",
    "InstanceOfClass",
    "JointOpenness",
    "JointSummary",
    "LargerRow",
    "LiquidBasis",
    "LiquidContainerRow",
    "MapCounts",
    "MapDifference",
    "MapEquality",
    "MapInfo",
    "MapMember",
    "MapName",
    "Measure",
    "MisplacedRow",
    "MissingKnowledge",
    "NeighborRow",
    "OpenState",
    "PartOf",
    "PlaceRelation",
    "PoseRow",
    "PropertyName",
    "Question",
    "QuestionArgument",
    "ReachabilityRow",
    "ReferenceFrame",
    "RoomBasis",
    "RoomRow",
    "SiblingClasses",
    "SimilarRow",
    "SpatialRelationRow",
    "StateRow",
    "StoragePlace",
    "StoragePlaceInMap",
    "SubclassRelation",
    "ValueName",
    "VisibilityRow",
    "analyse",
    "answers_to_builtins",
    "can_hold_liquid",
    "cell_text",
    "class_properties",
    "device_for_action",
    "device_for_action_in_environment",
    "differences",
    "direction_of",
    "distance",
    "everything_in_map",
    "fits",
    "free_place",
    "get_question",
    "handle_of",
    "how_many",
    "identical_maps",
    "in_room",
    "individual_of_class",
    "is_between",
    "larger_than",
    "list_questions",
    "maps",
    "misplaced",
    "nearest",
    "openings",
    "part_of",
    "path",
    "pose_of",
    "question",
    "reachable",
    "siblings",
    "similar_to",
    "states",
    "storage_place",
    "storage_place_in_environment",
    "subclass_of",
    "subject_column",
    "visible_from",
    "what_is",
    "where_is",
]

_MODULES = (
    "mindstage.knowledge.questions",
    *(
        f"{__name__}.{module}"
        for module in (
            "individuals",
            "spatial",
            "proximity",
            "storage",
            "inventory",
            "maps",
            "navigation",
            "taxonomy",
            "visibility",
        )
    ),
)


def __getattr__(name: str) -> object:
    for module in map(import_module, _MODULES if name in __all__ else ()):
        if name in module.__all__:
            value: object = getattr(module, name)
            globals()[name] = value
            return value
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
