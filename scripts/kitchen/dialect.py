"""The text of a semantic map in the dialect that the SemLog plugin writes: RDF/XML, one block for each thing."""

from __future__ import annotations

from collections.abc import Iterator

from kitchen.model import Joint, Kind, Motion, Scene, Thing

__all__ = ["map_text"]

MAP = "kitchen"
ONTOLOGY = "http://mindstage.org/ontology/household.ttl"

HEAD = f"""<?xml version="1.0" encoding="utf-8"?>

<!-- Written by scripts/make_kitchen.py: change the kitchen there, not here. -->
<!DOCTYPE rdf:RDF[
	<!ENTITY owl "http://www.w3.org/2002/07/owl#">
	<!ENTITY xsd "http://www.w3.org/2001/XMLSchema#">
	<!ENTITY knowrob "http://knowrob.org/kb/knowrob.owl#">
	<!ENTITY rdfs "http://www.w3.org/2000/01/rdf-schema#">
	<!ENTITY rdf "http://www.w3.org/1999/02/22-rdf-syntax-ns#">
	<!ENTITY ms "http://mindstage.org/ontology#">
	<!ENTITY kitchen "http://mindstage.org/maps/kitchen.owl#">
]>

<rdf:RDF xmlns="http://mindstage.org/maps/kitchen.owl#"
		xml:base="http://mindstage.org/maps/kitchen.owl#"
		xmlns:owl="http://www.w3.org/2002/07/owl#"
		xmlns:xsd="http://www.w3.org/2001/XMLSchema#"
		xmlns:knowrob="http://knowrob.org/kb/knowrob.owl#"
		xmlns:rdfs="http://www.w3.org/2000/01/rdf-schema#"
		xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#"
		xmlns:ms="http://mindstage.org/ontology#"
		xmlns:kitchen="http://mindstage.org/maps/kitchen.owl#">

	<!-- Ontologies -->
	<owl:Ontology rdf:about="http://mindstage.org/maps/kitchen.owl">
		<owl:imports rdf:resource="{ONTOLOGY}"/>
	</owl:Ontology>

	<!-- Property Definitions -->
	<owl:ObjectProperty rdf:about="&knowrob;describedInMap"/>
	<owl:DatatypeProperty rdf:about="&knowrob;quaternion"/>
	<owl:DatatypeProperty rdf:about="&knowrob;translation"/>

	<!-- Class Definitions -->
	<owl:Class rdf:about="&knowrob;SemanticEnvironmentMap"/>
	<owl:Class rdf:about="&knowrob;Pose"/>
"""

FOOT = "</rdf:RDF>\n"

QUATERNIONS = (
    "1.000000 0.000000 0.000000 0.000000",
    "0.707107 0.000000 0.000000 0.707107",
    "0.000000 0.000000 0.000000 1.000000",
    "0.707107 0.000000 0.000000 -0.707107",
)

LIMITED, LOCKED = 1, 2


def map_text(scene: Scene) -> str:
    """The whole map; the same scene gives the same text, to the letter."""
    blocks = [HEAD]
    blocks += [kind_block(kind) for kind in scene.kinds()]
    blocks.append(individual(MAP, "Semantic Map", [resource("rdf:type", "&knowrob;SemanticEnvironmentMap")]))
    relations = relations_of(scene)
    blocks += [thing_block(thing, relations.get(thing.id, [])) for thing in scene.things.values()]
    blocks += [joint_block(joint) for joint in scene.joints]
    return "\n".join(blocks) + FOOT


def kind_block(kind: Kind) -> str:
    """A class with its size in meters."""
    sizes = zip(("depth", "width", "height"), kind.size, strict=True)
    restrictions = "".join(
        f"""		<rdfs:subClassOf>
			<owl:Restriction>
				<owl:onProperty rdf:resource="&knowrob;{name}OfObject"/>
				<owl:hasValue rdf:datatype="&xsd;float">{value / 1000}</owl:hasValue>
			</owl:Restriction>
		</rdfs:subClassOf>
"""
        for name, value in sizes
    )
    return f"""	<!-- Class {kind.name} -->
	<owl:Class rdf:about="&ms;{kind.name}">
		<rdfs:subClassOf rdf:resource="{entity(kind.base)}"/>
{restrictions}	</owl:Class>
"""


def relations_of(scene: Scene) -> dict[str, list[str]]:
    """Who hangs on what: told by the parent, by the child, or by both in turn, as maps in the wild do."""
    lines: dict[str, list[str]] = {}
    for number, thing in enumerate(thing for thing in scene.things.values() if thing.parent):
        if number % 3 != 1:
            lines.setdefault(str(thing.parent), []).append(resource("knowrob:child", f"&kitchen;{thing.id}"))
        if number % 3 != 0:
            lines.setdefault(thing.id, []).append(resource("knowrob:parent", f"&kitchen;{thing.parent}"))
    return lines


def thing_block(thing: Thing, relations: list[str]) -> str:
    """An object and its pose."""
    pose = f"{thing.id}_pose"
    lines = [
        resource("rdf:type", f"&ms;{thing.kind.name}"),
        resource("knowrob:describedInMap", f"&kitchen;{MAP}"),
        *relations,
        literal("mobility", "string", thing.mobility.value),
        literal("mass", "float", thing.kind.mass_kg),
        literal("overlapEvents", "boolean", "false"),
        literal("gravity", "boolean", "true"),
        resource("knowrob:pose", f"&kitchen;{pose}"),
        literal("tagsData", "string", f"SemLog;Class,{thing.kind.name};Id,{thing.id};"),
    ]
    return individual(thing.id, thing.kind.name, lines) + pose_block(pose, thing)


def pose_block(id: str, at: Thing | Joint) -> str:
    """Where something is, in meters."""
    # Adding 0.0 turns a negative zero into a positive one.
    translation = " ".join(f"{value / 1000 + 0.0:.6f}" for value in (at.x, at.y, at.z))
    lines = [
        resource("rdf:type", "&knowrob;Pose"),
        literal("quaternion", "string", QUATERNIONS[at.turns % 4]),
        literal("translation", "string", translation),
    ]
    return individual(id, "", lines)


def joint_block(joint: Joint) -> str:
    """A constraint, its pose, and what it allows."""
    parent, child = (joint.part, joint.case) if joint.upside_down else (joint.case, joint.part)
    lines = [
        resource("rdf:type", "&knowrob;Constraint"),
        resource("knowrob:parent", f"&kitchen;{parent}"),
        resource("knowrob:child", f"&kitchen;{child}"),
        resource("knowrob:describedInMap", f"&kitchen;{MAP}"),
        literal("tagsData", "string", f"SemLog;Id,{joint.id};"),
        resource("knowrob:pose", f"&kitchen;{joint.id}_pose"),
        resource("knowrob:linearConstraint", f"&kitchen;{joint.id}_linear"),
        resource("knowrob:angularConstraint", f"&kitchen;{joint.id}_angular"),
    ]
    return (
        individual(joint.id, "Constraint", lines)
        + pose_block(f"{joint.id}_pose", joint)
        + individual(f"{joint.id}_linear", "", list(linear_lines(joint)))
        + individual(f"{joint.id}_angular", "", list(angular_lines(joint)))
    )


def linear_lines(joint: Joint) -> Iterator[str]:
    """What a joint allows along its axes."""
    slides = joint.motion is Motion.SLIDE
    yield resource("rdf:type", "&knowrob;LinearConstraint")
    yield literal("xMotion", "integer", LIMITED if slides else LOCKED)
    yield literal("yMotion", "integer", LOCKED)
    yield literal("zMotion", "integer", LOCKED)
    yield literal("limit", "float", joint.limit if slides else 0.0)
    yield from soft_lines("softConstraint", "stiffness", "damping")


def angular_lines(joint: Joint) -> Iterator[str]:
    """What a joint allows about its axes."""
    yield resource("rdf:type", "&knowrob;AngularConstraint")
    for axis, motion in (("swing1", Motion.SWING), ("swing2", Motion.TILT), ("twist", None)):
        yield literal(f"{axis}Motion", "integer", LIMITED if joint.motion is motion else LOCKED)
    for axis, motion in (("swing1", Motion.SWING), ("swing2", Motion.TILT), ("twist", None)):
        yield literal(f"{axis}Limit", "float", joint.limit if joint.motion is motion else 0.0)
    yield from soft_lines("softSwingConstraint", "swingStiffness", "swingDamping")
    yield from soft_lines("softTwistConstraint", "twistStiffness", "twistDamping")


def soft_lines(soft: str, stiffness: str, damping: str) -> Iterator[str]:
    """A limit that does not give."""
    yield literal(soft, "boolean", "false")
    yield literal(stiffness, "float", 0.0)
    yield literal(damping, "float", 0.0)


def individual(id: str, title: str, lines: list[str]) -> str:
    """A block; without a title it belongs to the one before."""
    heading = (
        f"	<!-- {title if title in ('Constraint', 'Semantic Map') else 'Individual ' + title} -->\n" if title else ""
    )
    return f"""{heading}	<owl:NamedIndividual rdf:about="&kitchen;{id}">
{"".join(lines)}	</owl:NamedIndividual>
"""


def resource(name: str, value: str) -> str:
    """A statement about something that has a name."""
    return f'		<{name} rdf:resource="{value}"/>\n'


def literal(name: str, datatype: str, value: object) -> str:
    """A statement with a value."""
    return f'		<knowrob:{name} rdf:datatype="&xsd;{datatype}">{value}</knowrob:{name}>\n'


def entity(name: str) -> str:
    """A prefixed name with the prefix as an entity."""
    return "&" + name.replace(":", ";", 1)
