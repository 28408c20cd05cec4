"""The names that maps are written in, and our own for what the community has no word for.

`knowrob_iri:` and the W3C's names are those of dialect 1. Whatever a world knows beyond them stands under `ms:`
(`http://mindstage.org/ontology#`), so that any world survives as a file:

| name | said of | meaning |
|---|---|---|
| `ms:id` | body, constraint, light | its id, where that is not simply the local name of its IRI |
| `ms:shape` | body | `box`, `sphere` or `cylinder` |
| `ms:name` | body | a surface: a node with `ms:index` (from 0), `ms:name`, `ms:path`, `ms:colour` "r g b" |
| `ms:tags` | all three | tags that `tagsData` has no writing for, as a JSON array of [type, key, value] |
| `ms:xMiddle`, `ms:yMiddle`, `ms:zMiddle` | linear part | the middle of its range, if not the spawn pose [m] |
| `ms:twistMiddle`, `ms:swing1Middle`, `ms:swing2Middle` | angular part | the same [rad] |
| `ms:disableCollision` | constraint | whether its two bodies ignore each other; not told where the world does not say |
| `ms:PointLight`, `ms:SpotLight`, `ms:DirectionalLight` | light | its class |
| `ms:colour`, `ms:intensity` | light | "r g b" (0 to 1), and candela or lux |
| `ms:units` | map | what its lengths are counted in: `m`, `cm` or `mm` |
| `ms:frame`, `ms:quaternionOrder` | map | which way its axes point, `ros` or `unreal`; `wxyz` or `xyzw` |
| `ms:given…` | all | what a map said under the name after `given`, where now something else stands in its place |
| `ms:dialect` | map | that we have written it in other words than dialect 1's: `SOMA`, or `same` for its own |
| `ms:restates` | node | that it says in those words what dialect 1 says by the property named |
| `ms:urdf` | body, constraint, map | the text of the element of a robot's description that it was read from |
| `ms:untold` | all three | names a property whose statements here are facts only and give no field its value |

A label is `rdfs:label`, and so is the name of a map where it is not the local name of the map's IRI.

Other words: names that dialects other than the first use for places, parts and joints.

`knowrob_iri:` names are KnowRob 1's (2009 to 2016), `soma:` and `dul:` those of KnowRob 2, which has `urdf:` from robots'
descriptions.
"""

from __future__ import annotations

from mindstage.scene import Iri, LightType

__all__ = [
    "ANGULAR_CONSTRAINT",
    "BASE_LINK_NAME",
    "CHILD",
    "CONNECTIONS",
    "CONSTRAINT",
    "DATATYPE_PROPERTY",
    "DESCRIBED_IN_MAP",
    "DIALECT",
    "DUL",
    "END_LINK_NAME",
    "EQUIVALENT_CLASS",
    "EVENT_OCCURS_AT",
    "FRAME",
    "HAS_ANGULAR",
    "HAS_COLOR",
    "HAS_JOINT",
    "HAS_LINEAR",
    "HAS_LOCALIZATION",
    "HAS_POSE",
    "HAS_SHAPE",
    "HAS_VALUE",
    "HINGED_TO",
    "IMPORTS",
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
    "POSE",
    "POSE_PROPERTIES",
    "PRISMATICALLY_CONNECTED_TO",
    "QUATERNION_ORDER",
    "RDF",
    "RDFS",
    "RESTATES",
    "REVOLUTE_JOINT",
    "SEMANTIC_MAP",
    "SOMA",
    "START_TIME",
    "SUBCLASS_OF",
    "TAGS_DATA",
    "TAGS_JSON",
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
    """A name of the community's."""
    return Iri(KNOWROB + name)


def ms(name: str) -> Iri:
    """A name of our own."""
    return Iri(MS + name)


def xsd(name: str) -> Iri:
    """A datatype."""
    return Iri(XSD + name)


TYPE = Iri(RDF + "type")
LABEL = Iri(RDFS + "label")
SUBCLASS_OF = Iri(RDFS + "subClassOf")
EQUIVALENT_CLASS = Iri(OWL + "equivalentClass")
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
"""AMEVA's."""

TAGS_JSON = ms("tags")
MATERIAL = ms("material")
UNITS = ms("units")
FRAME = ms("frame")
QUATERNION_ORDER = ms("quaternionOrder")
DIALECT = ms("dialect")
RESTATES = ms("restates")
UNTOLD = ms("untold")
URDF_TEXT = ms("urdf")
LIGHT_CLASSES = {
    LightType.POINT: ms("PointLight"),
    LightType.SPOT: ms("SpotLight"),
    LightType.DIRECTIONAL: ms("DirectionalLight"),
}


DUL = "http://www.ontologydesignpatterns.org/ont/dul/DUL.owl#"
SOMA = "http://www.ease-crc.org/ont/SOMA.owl#"
URDF = "http://knowrob.org/kb/urdf.owl#"


def dul(name: str) -> Iri:
    """A name of the foundational ontology."""
    return Iri(DUL + name)


def soma(name: str) -> Iri:
    """A name of the socio-physical model of activities."""
    return Iri(SOMA + name)


def urdf(name: str) -> Iri:
    """A name for what stands in robots' descriptions."""
    return Iri(URDF + name)


ORIENTATION = knowrob("orientation")
"""Straight from an object to a matrix, before there were perceptions."""
OBJECT_ACTED_ON = knowrob("objectActedOn")
EVENT_OCCURS_AT = knowrob("eventOccursAt")
START_TIME = knowrob("startTime")
JOINT_VALUES = (knowrob("minJointValue"), knowrob("maxJointValue"))

HINGED_TO, PRISMATICALLY_CONNECTED_TO = knowrob("hingedTo"), knowrob("prismaticallyConnectedTo")
_RIGID = (knowrob("rigidlyFixedParts"), knowrob("connectedTo-Rigidly"), knowrob("connectedToRigidly"))
CONNECTIONS = (*_RIGID, HINGED_TO, PRISMATICALLY_CONNECTED_TO)
"""What two things that hang together say of each other, whichever of them says it."""

TO_PARTS = (
    *(knowrob("properPhysicalParts"), knowrob("physicalParts"), knowrob("parts")),
    *(dul("hasPart"), dul("hasProperPart"), dul("hasComponent"), soma("hasPhysicalComponent")),
)
TO_WHOLES = (
    *(knowrob("properPhysicalPartOf"), knowrob("physicalPartOf"), knowrob("partOf")),
    *(dul("isPartOf"), dul("isProperPartOf"), dul("isComponentOf"), soma("isPhysicalComponentOf")),
)

HAS_LOCALIZATION = soma("hasLocalization")
HAS_SHAPE = soma("hasShape")
HAS_COLOR = soma("hasColor")
HAS_JOINT = urdf("hasJoint")
BASE_LINK_NAME, END_LINK_NAME = urdf("hasBaseLinkName"), urdf("hasEndLinkName")
URDF_LINK = urdf("Link")

POSE_PROPERTIES = (ORIENTATION, OBJECT_ACTED_ON, HAS_LOCALIZATION, BASE_LINK_NAME, END_LINK_NAME)
"""Who says one of these of something, or is said to have been perceived, has a place."""
