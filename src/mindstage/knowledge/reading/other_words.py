"""Other words: names that dialects other than the first use for places, parts and joints.

`knowrob_iri:` names are KnowRob 1's (2009 to 2016), `soma:` and `dul:` those of KnowRob 2, which has `urdf:` from robots'
descriptions.
"""

from __future__ import annotations

from mindstage.knowledge.vocabulary import knowrob
from mindstage.world import Iri

__all__ = [
    "BASE_LINK_NAME",
    "CONNECTIONS",
    "DUL",
    "END_LINK_NAME",
    "EVENT_OCCURS_AT",
    "HAS_COLOR",
    "HAS_JOINT",
    "HAS_LOCALIZATION",
    "HAS_SHAPE",
    "HINGED_TO",
    "JOINT_VALUES",
    "OBJECT_ACTED_ON",
    "ORIENTATION",
    "POSE_PROPERTIES",
    "PRISMATICALLY_CONNECTED_TO",
    "SOMA",
    "START_TIME",
    "TO_PARTS",
    "TO_WHOLES",
    "URDF",
    "URDF_LINK",
    "dul",
    "soma",
    "urdf",
]

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
