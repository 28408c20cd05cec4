"""The questions: each declared once, for Python, shell and whatever else asks."""

from mindstage.knowledge.questions.comparisons import MapDifference, SameMaps, differences, identical_maps
from mindstage.knowledge.questions.composition import HandleOf, PartOf, handle_of, part_of
from mindstage.knowledge.questions.devices import (
    Device,
    DeviceHere,
    device_for_action,
    device_for_action_in_environment,
)
from mindstage.knowledge.questions.kinds import (
    ClassProperty,
    Sibling,
    Subclass,
    class_properties,
    siblings,
    subclass_of,
)
from mindstage.knowledge.questions.openings import Opening, State, openings
from mindstage.knowledge.questions.places import (
    InMap,
    KnownMap,
    MapClass,
    everything_in_map,
    individual_of_class,
    maps,
)
from mindstage.knowledge.questions.question import (
    Answers,
    Argument,
    ClassName,
    IndividualName,
    MapName,
    Missing,
    PropertyName,
    Question,
    Row,
    ValueName,
    question,
    question_named,
    questions,
)
from mindstage.knowledge.questions.space import Where, where_is
from mindstage.knowledge.questions.storage import Storage, StorageHere, storage_place, storage_place_in_environment
from mindstage.knowledge.questions.telling import about_column, answers_to_builtins, cell_text
from mindstage.knowledge.questions.things import Counts, Joint, Thing, analyse, what_is

__all__ = [
    "Answers",
    "Argument",
    "ClassName",
    "ClassProperty",
    "Counts",
    "Device",
    "DeviceHere",
    "HandleOf",
    "InMap",
    "IndividualName",
    "Joint",
    "KnownMap",
    "MapClass",
    "MapDifference",
    "MapName",
    "Missing",
    "Opening",
    "PartOf",
    "PropertyName",
    "Question",
    "Row",
    "SameMaps",
    "Sibling",
    "State",
    "Storage",
    "StorageHere",
    "Subclass",
    "Thing",
    "ValueName",
    "Where",
    "about_column",
    "analyse",
    "answers_to_builtins",
    "cell_text",
    "class_properties",
    "device_for_action",
    "device_for_action_in_environment",
    "differences",
    "everything_in_map",
    "handle_of",
    "identical_maps",
    "individual_of_class",
    "maps",
    "openings",
    "part_of",
    "question",
    "question_named",
    "questions",
    "siblings",
    "storage_place",
    "storage_place_in_environment",
    "subclass_of",
    "what_is",
    "where_is",
]
