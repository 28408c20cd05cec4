"""The vocabulary of maps: W3C terms, those of the KnowRob community, and our own for what has no term there.

`knowrob:` and the W3C terms are those of dialect 1. Everything else that a world contains is written with terms of
`ms:` (`http://mindstage.org/ontology#`), so that any world survives as a file:

| term | of | meaning |
|---|---|---|
| `ms:id` | body, joint, light | its id, if that is not the local name of its IRI |
| `ms:shape` | body | `box`, `sphere` or `cylinder` |
| `ms:material` | body | a surface: a node with `ms:index` (from 0), `ms:name`, `ms:path`, `ms:colour` "r g b" |
| `ms:tags` | all three | tags that `tagsData` cannot express, as a JSON array of [type, key, value] |
| `ms:xMiddle`, `ms:yMiddle`, `ms:zMiddle` | linear part | the middle of its range, if not the spawn pose [m] |
| `ms:twistMiddle`, `ms:swing1Middle`, `ms:swing2Middle` | angular part | the same [rad] |
| `ms:disableCollision` | joint | whether its two bodies do not collide; absent if unspecified |
| `ms:PointLight`, `ms:SpotLight`, `ms:DirectionalLight` | light | its class |
| `ms:colour`, `ms:intensity` | light | "r g b" (0 to 1), and candela or lux |
| `ms:units` | map | the unit of its lengths: `m`, `cm` or `mm` |
| `ms:frame`, `ms:quaternionOrder` | map | the direction of its axes, `ros` or `unreal`; `wxyz` or `xyzw` |
| `ms:sizes` | map | what the sizes of its classes are measured along: the axes of the `body`, or of the `world` |
| `ms:givenSizes` | map | the same of the source: the boxes of bodies have been derived, none is to be inferred again |
| `ms:pivot` | pose | the pose is that of a mesh pivot, which is here relative to the center of the box [m] |
| `ms:given…` | all | the original value of the property after `given`, which was converted |
| `ms:dialect` | map | the dialect that it was written in, if not dialect 1: `SOMA`, or `same` for its own |
| `ms:restates` | node | the property of dialect 1 that the node expresses in the terms of another dialect |
| `ms:urdf` | body, joint, map | the text of the URDF element that it was read from |
| `ms:untold` | all three | a property whose statements here do not set the corresponding field |

A label is `rdfs:label`, and so is the name of a map if it is not the local name of the map's IRI.

Other dialects have their own terms for poses, parts and joints: those of KnowRob 1 (2009 to 2016) are in `knowrob:`,
those of KnowRob 2 in `soma:` and `dul:`, with `urdf:` for links and joints of robot descriptions.
"""

from __future__ import annotations

from mindstage.scene import Iri, LightType

__all__ = [
    "AFFORDS_TASK",
    "AFFORDS_TRIGGER",
    "ANGULAR_CONSTRAINT",
    "ASSUMED",
    "ASSUMED_MOBILITY",
    "ASSUMED_PARENT",
    "BASE_LINK_NAME",
    "CHILD",
    "CLASSIFIES",
    "CONNECTIONS",
    "CONSTRAINT",
    "DATATYPE_PROPERTY",
    "DESCRIBED_IN_MAP",
    "DIALECT",
    "DOOR_HINGED_TO",
    "DOOR_HINGED_WITH",
    "DUL",
    "END_LINK_NAME",
    "EQUIVALENT_CLASS",
    "EVENT",
    "EVENT_OCCURS_AT",
    "FIRST",
    "FRAME",
    "GIVEN_SIZES",
    "HAS_ANGULAR",
    "HAS_COLOR",
    "HAS_DISPOSITION",
    "HAS_JOINT",
    "HAS_LINEAR",
    "HAS_LOCALIZATION",
    "HAS_POSE",
    "HAS_SHAPE",
    "HAS_VALUE",
    "HINGED_TO",
    "IMPORTS",
    "INTERSECTION_OF",
    "JOINT_CLASSES",
    "JOINT_VALUES",
    "KNOWROB",
    "LABEL",
    "LIGHT_CLASSES",
    "LINEAR_CONSTRAINT",
    "LINEAR_JOINT",
    "MATERIAL",
    "MS",
    "NAMED_INDIVIDUAL",
    "OBJECT_ACTED_ON",
    "OBJECT_PROPERTY",
    "ONTOLOGY",
    "ON_PROPERTY",
    "ORIENTATION",
    "OWL",
    "OWL_CLASS",
    "PARENT",
    "PIVOT",
    "POSE",
    "POSE_PROPERTIES",
    "PRISMATICALLY_CONNECTED_TO",
    "QUATERNION_ORDER",
    "RDF",
    "RDFS",
    "REST",
    "RESTATES",
    "REVOLUTE_JOINT",
    "SEMANTIC_MAP",
    "SIZES",
    "SOMA",
    "SOMA_NAMESPACES",
    "SRDL",
    "START_TIME",
    "STORAGE",
    "SUBCLASS_OF",
    "SUCCEEDING_JOINT",
    "SUCCEEDING_LINK",
    "SYNONYM",
    "TAGS_DATA",
    "TAGS_JSON",
    "TASK_AFFORDED_BY",
    "THING",
    "TO_PARTS",
    "TO_WHOLES",
    "TYPE",
    "UNITS",
    "UNTOLD",
    "URDF",
    "URDF_LINK",
    "URDF_TEXT",
    "VERSION_IRI",
    "XSD",
    "dul",
    "knowrob",
    "ms",
    "soma",
    "srdl",
    "urdf",
    "xsd",
]


RDF = "http://www.w3.org/1999/02/22-rdf-syntax-ns#"
RDFS = "http://www.w3.org/2000/01/rdf-schema#"
OWL = "http://www.w3.org/2002/07/owl#"
XSD = "http://www.w3.org/2001/XMLSchema#"
KNOWROB = "http://knowrob.org/kb/knowrob.owl#"
MS = "http://mindstage.org/ontology#"


def knowrob(name: str) -> Iri:
    """A term of the KnowRob community."""
    return Iri(KNOWROB + name)


def ms(name: str) -> Iri:
    """A term of Mindstage."""
    return Iri(MS + name)


def xsd(name: str) -> Iri:
    """A datatype of XML Schema."""
    return Iri(XSD + name)


TYPE = Iri(RDF + "type")
LABEL = Iri(RDFS + "label")
SYNONYM = Iri("http://www.w3.org/2004/02/skos/core#altLabel")
SUBCLASS_OF = Iri(RDFS + "subClassOf")
EQUIVALENT_CLASS = Iri(OWL + "equivalentClass")
INTERSECTION_OF = Iri(OWL + "intersectionOf")
FIRST, REST = Iri(RDF + "first"), Iri(RDF + "rest")
ON_PROPERTY = Iri(OWL + "onProperty")
HAS_VALUE = Iri(OWL + "hasValue")
IMPORTS = Iri(OWL + "imports")
VERSION_IRI = Iri(OWL + "versionIRI")
NAMED_INDIVIDUAL = Iri(OWL + "NamedIndividual")
OBJECT_PROPERTY = Iri(OWL + "ObjectProperty")
DATATYPE_PROPERTY = Iri(OWL + "DatatypeProperty")
OWL_CLASS = Iri(OWL + "Class")
ONTOLOGY = Iri(OWL + "Ontology")
THING = Iri(OWL + "Thing")

EVENT = knowrob("Event")
SEMANTIC_MAP = knowrob("SemanticEnvironmentMap")
POSE = knowrob("Pose")
CONSTRAINT = knowrob("Constraint")
LINEAR_CONSTRAINT = knowrob("LinearConstraint")
ANGULAR_CONSTRAINT = knowrob("AngularConstraint")
DESCRIBED_IN_MAP = knowrob("describedInMap")
HAS_POSE = knowrob("pose")
HAS_LINEAR = knowrob("linearConstraint")
HAS_ANGULAR = knowrob("angularConstraint")
PARENT = knowrob("parent")
CHILD = knowrob("child")
TAGS_DATA = knowrob("tagsData")
LINEAR_JOINT = knowrob("LinearJoint")
REVOLUTE_JOINT = knowrob("RevoluteJoint")
JOINT_CLASSES = frozenset({LINEAR_JOINT, REVOLUTE_JOINT})
"""The joint classes of AMEVA."""

TAGS_JSON = ms("tags")
MATERIAL = ms("material")
UNITS = ms("units")
FRAME = ms("frame")
QUATERNION_ORDER = ms("quaternionOrder")
SIZES = ms("sizes")
PIVOT = ms("pivot")
GIVEN_SIZES = ms("givenSizes")
DIALECT = ms("dialect")
RESTATES = ms("restates")
UNTOLD = ms("untold")
ASSUMED, ASSUMED_MOBILITY, ASSUMED_PARENT = ms("assumed"), ms("assumedMobility"), ms("assumedParent")
URDF_TEXT = ms("urdf")
LIGHT_CLASSES = {
    LightType.POINT: ms("PointLight"),
    LightType.SPOT: ms("SpotLight"),
    LightType.DIRECTIONAL: ms("DirectionalLight"),
}


DUL = "http://www.ontologydesignpatterns.org/ont/dul/DUL.owl#"
SOMA = "http://www.ease-crc.org/ont/SOMA.owl#"
SOMA_NAMESPACES = (
    SOMA,
    *(f"http://www.ease-crc.org/ont/{name}.owl#" for name in ("SOMA-HOME", "SOMA-OBJ", "SOMA-ACT")),
)
"""The namespaces of SOMA; its modules had their own in some versions."""
SRDL = "http://knowrob.org/kb/srdl2-comp.owl#"
URDF = "http://knowrob.org/kb/urdf.owl#"


def dul(name: str) -> Iri:
    """A term of the DUL ontology."""
    return Iri(DUL + name)


def soma(name: str) -> Iri:
    """A term of the SOMA ontology."""
    return Iri(SOMA + name)


def srdl(name: str) -> Iri:
    """A term of SRDL 2 for the components of robots."""
    return Iri(SRDL + name)


def urdf(name: str) -> Iri:
    """A term for robot descriptions."""
    return Iri(URDF + name)


ORIENTATION = knowrob("orientation")
"""Relates an object directly to a pose matrix, in the oldest maps."""
OBJECT_ACTED_ON = knowrob("objectActedOn")
EVENT_OCCURS_AT = knowrob("eventOccursAt")
START_TIME = knowrob("startTime")
JOINT_VALUES = (knowrob("minJointValue"), knowrob("maxJointValue"))

HINGED_TO, PRISMATICALLY_CONNECTED_TO = knowrob("hingedTo"), knowrob("prismaticallyConnectedTo")
_RIGID = (knowrob("rigidlyFixedParts"), knowrob("connectedTo-Rigidly"), knowrob("connectedToRigidly"))
DOOR_HINGED_TO, DOOR_HINGED_WITH = knowrob("doorHingedTo"), knowrob("doorHingedWith")
"""From a door to its casing, and to its joint."""
CONNECTIONS = (*_RIGID, HINGED_TO, PRISMATICALLY_CONNECTED_TO)
"""The properties between two connected objects; either of them may have the property."""

TO_PARTS = (
    *(knowrob("properPhysicalParts"), knowrob("physicalParts"), knowrob("parts")),
    *(dul("hasPart"), dul("hasProperPart"), dul("hasComponent"), soma("hasPhysicalComponent")),
)
TO_WHOLES = (
    *(knowrob("properPhysicalPartOf"), knowrob("physicalPartOf"), knowrob("partOf")),
    *(dul("isPartOf"), dul("isProperPartOf"), dul("isComponentOf"), soma("isPhysicalComponentOf")),
)

HAS_DISPOSITION, AFFORDS_TASK, AFFORDS_TRIGGER = soma("hasDisposition"), soma("affordsTask"), soma("affordsTrigger")
TASK_AFFORDED_BY, CLASSIFIES, STORAGE = soma("isTaskAffordedBy"), dul("classifies"), soma("Storage")
HAS_LOCALIZATION = soma("hasLocalization")
HAS_SHAPE = soma("hasShape")
HAS_COLOR = soma("hasColor")
HAS_JOINT = urdf("hasJoint")
BASE_LINK_NAME, END_LINK_NAME = urdf("hasBaseLinkName"), urdf("hasEndLinkName")
URDF_LINK = urdf("Link")

SUCCEEDING_LINK, SUCCEEDING_JOINT = srdl("succeedingLink"), srdl("succeedingJoint")

POSE_PROPERTIES = (ORIENTATION, OBJECT_ACTED_ON, HAS_LOCALIZATION, BASE_LINK_NAME, END_LINK_NAME)
"""An individual that has one of these, or that is their value (a perceived object), has a pose."""
