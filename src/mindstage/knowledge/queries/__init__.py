"""The questions: each declared once, for Python, shell and whatever else asks."""

from mindstage.knowledge.questions.comparisons import MapDifference, MapEquality, differences, identical_maps
from mindstage.knowledge.questions.composition import HandleOf, PartOf, handle_of, part_of
from mindstage.knowledge.questions.devices import (
    ActionDevice,
    ActionDeviceInMap,
    device_for_action,
    device_for_action_in_environment,
)
from mindstage.knowledge.questions.kinds import (
    ClassRestrictionRow,
    SiblingClasses,
    SubclassRelation,
    class_properties,
    siblings,
    subclass_of,
)
from mindstage.knowledge.questions.openings import JointOpenness, OpenState, openings
from mindstage.knowledge.questions.places import (
    InstanceOfClass,
    MapInfo,
    MapMember,
    everything_in_map,
    individual_of_class,
    maps,
)
from mindstage.knowledge.questions.question import (
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
    get_question,
    list_questions,
    question,
)
from mindstage.knowledge.questions.space import SpatialRelationRow, where_is
from mindstage.knowledge.questions.storage import (
    StoragePlace,
    StoragePlaceInMap,
    storage_place,
    storage_place_in_environment,
)
from mindstage.knowledge.questions.telling import answers_to_builtins, cell_text, subject_column
from mindstage.knowledge.questions.things import IndividualDescription, JointSummary, MapCounts, analyse, what_is

__all__ = [
    "ActionDevice",
    "ActionDeviceInMap",
    "AnswerRow",
    "Answers",
    "ClassName",
    "ClassRestrictionRow",
    "HandleOf",
    "IndividualDescription",
    "IndividualName",
    "InstanceOfClass",
    "JointOpenness",
    "JointSummary",
    "MapCounts",
    "MapDifference",
    "MapEquality",
    "MapInfo",
    "MapMember",
    "MapName",
    "MissingKnowledge",
    "OpenState",
    "PartOf",
    "PropertyName",
    "Question",
    "QuestionArgument",
    "SiblingClasses",
    "SpatialRelationRow",
    "StoragePlace",
    "StoragePlaceInMap",
    "SubclassRelation",
    "ValueName",
    "analyse",
    "answers_to_builtins",
    "cell_text",
    "class_properties",
    "device_for_action",
    "device_for_action_in_environment",
    "differences",
    "everything_in_map",
    "get_question",
    "handle_of",
    "identical_maps",
    "individual_of_class",
    "list_questions",
    "maps",
    "openings",
    "part_of",
    "question",
    "siblings",
    "storage_place",
    "storage_place_in_environment",
    "subclass_of",
    "subject_column",
    "what_is",
    "where_is",
]
