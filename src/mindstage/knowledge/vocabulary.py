"""The names that maps are written in, and our own for what the community has no word for.

`knowrob:` and the W3C's names are those of dialect 1. Whatever a world knows beyond them stands under `ms:`
(`http://mindstage.org/ontology#`), so that any world survives as a file:

| name | said of | meaning |
|---|---|---|
| `ms:id` | body, constraint, light | its id, where that is not simply the local name of its IRI |
| `ms:shape` | body | `box`, `sphere` or `cylinder` |
| `ms:material` | body | a surface: a node with `ms:index` (from 0), `ms:name`, `ms:path`, `ms:colour` "r g b" |
| `ms:tags` | all three | tags that `tagsData` has no writing for, as a JSON array of [type, key, value] |
| `ms:disableCollision` | constraint | whether its two bodies ignore each other; not told where the world does not say |
| `ms:PointLight`, `ms:SpotLight`, `ms:DirectionalLight` | light | its class |
| `ms:colour`, `ms:intensity` | light | "r g b" (0 to 1), and candela or lux |
| `ms:untold` | all three | names a property whose statements here are facts only and give no field its value |

A label is `rdfs:label`, and so is the name of a map where it is not the local name of the map's IRI.
"""

from __future__ import annotations

from mindstage.world import Iri, LightKind

__all__ = [
    "ANGULAR_CONSTRAINT",
    "CHILD",
    "CONSTRAINT",
    "DATATYPE_PROPERTY",
    "DESCRIBED_IN_MAP",
    "EQUIVALENT_CLASS",
    "HAS_ANGULAR",
    "HAS_LINEAR",
    "HAS_POSE",
    "HAS_VALUE",
    "IMPORTS",
    "KNOWROB",
    "LABEL",
    "LIGHT_CLASSES",
    "LINEAR_CONSTRAINT",
    "MATERIAL",
    "MS",
    "NAMED_INDIVIDUAL",
    "OBJECT_PROPERTY",
    "ONTOLOGY",
    "ON_PROPERTY",
    "OWL",
    "OWL_CLASS",
    "PARENT",
    "POSE",
    "RDF",
    "RDFS",
    "SEMANTIC_MAP",
    "SUBCLASS_OF",
    "TAGS_DATA",
    "TAGS_JSON",
    "THING",
    "TYPE",
    "UNTOLD",
    "VERSION_IRI",
    "XSD",
    "knowrob",
    "ms",
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

TAGS_JSON = ms("tags")
MATERIAL = ms("material")
UNTOLD = ms("untold")
LIGHT_CLASSES = {
    LightKind.POINT: ms("PointLight"),
    LightKind.SPOT: ms("SpotLight"),
    LightKind.DIRECTIONAL: ms("DirectionalLight"),
}
