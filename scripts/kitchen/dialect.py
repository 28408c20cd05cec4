"""Serialization of a scene as a semantic map in RDF/XML, in the layout of the SemLog plugin."""

from __future__ import annotations

from collections.abc import Iterator

from kitchen.model import Body, BodyType, Joint, Motion, Scene

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
    """Returns the map file; equal scenes give equal texts."""
    blocks = [HEAD]
    blocks += [body_type_block(body_type) for body_type in scene.body_types()]
    blocks.append(individual(MAP, "Semantic Map", [resource("rdf:type", "&knowrob;SemanticEnvironmentMap")]))
    relations = relations_of(scene)
    blocks += [body_block(body, relations.get(body.id, [])) for body in scene.bodies.values()]
    blocks += [joint_block(joint) for joint in scene.joints]
    return "\n".join(blocks) + FOOT


def body_type_block(body_type: BodyType) -> str:
    """Returns a class with its size [m]."""
    sizes = zip(("depth", "width", "height"), body_type.size, strict=True)
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
    return f"""	<!-- Class {body_type.name} -->
	<owl:Class rdf:about="&ms;{body_type.name}">
		<rdfs:subClassOf rdf:resource="{entity(body_type.base)}"/>
{restrictions}	</owl:Class>
"""


def relations_of(scene: Scene) -> dict[str, list[str]]:
    """Returns the attachments by subject; they are given by the parent, by the child or by both, as in real maps."""
    lines: dict[str, list[str]] = {}
    for number, body in enumerate(body for body in scene.bodies.values() if body.parent):
        if number % 3 != 1:
            lines.setdefault(str(body.parent), []).append(resource("knowrob:child", f"&kitchen;{body.id}"))
        if number % 3 != 0:
            lines.setdefault(body.id, []).append(resource("knowrob:parent", f"&kitchen;{body.parent}"))
    return lines


def body_block(body: Body, relations: list[str]) -> str:
    """Returns a body and its pose."""
    pose = f"{body.id}_pose"
    lines = [
        resource("rdf:type", f"&ms;{body.body_type.name}"),
        resource("knowrob:describedInMap", f"&kitchen;{MAP}"),
        *relations,
        literal("mobility", "string", body.mobility.value),
        literal("mass", "float", body.body_type.mass_kg),
        literal("overlapEvents", "boolean", "false"),
        literal("gravity", "boolean", "true"),
        resource("knowrob:pose", f"&kitchen;{pose}"),
        literal("tagsData", "string", f"SemLog;Class,{body.body_type.name};Id,{body.id};"),
    ]
    return individual(body.id, body.body_type.name, lines) + pose_block(pose, body)


def pose_block(id: str, at: Body | Joint) -> str:
    """Returns a pose [m]."""
    # Adding 0.0 turns a negative zero into a positive one.
    translation = " ".join(f"{value / 1000 + 0.0:.6f}" for value in (at.x, at.y, at.z))
    lines = [
        resource("rdf:type", "&knowrob;Pose"),
        literal("quaternion", "string", QUATERNIONS[at.turns % 4]),
        literal("translation", "string", translation),
    ]
    return individual(id, "", lines)


def joint_block(joint: Joint) -> str:
    """Returns a constraint with its pose and limits."""
    parent, child = (joint.part, joint.case) if joint.swapped_roles else (joint.case, joint.part)
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
    """Yields the translational limits of a joint."""
    slides = joint.motion is Motion.SLIDE
    yield resource("rdf:type", "&knowrob;LinearConstraint")
    yield literal("xMotion", "integer", LIMITED if slides else LOCKED)
    yield literal("yMotion", "integer", LOCKED)
    yield literal("zMotion", "integer", LOCKED)
    yield literal("limit", "float", half_range(joint) if slides else 0.0)
    if slides:
        yield middle("x", joint)
    yield from soft_lines("softConstraint", "stiffness", "damping")


def angular_lines(joint: Joint) -> Iterator[str]:
    """Yields the rotational limits of a joint."""
    yield resource("rdf:type", "&knowrob;AngularConstraint")
    for axis, motion in (("swing1", Motion.SWING), ("swing2", Motion.TILT), ("twist", None)):
        yield literal(f"{axis}Motion", "integer", LIMITED if joint.motion is motion else LOCKED)
    for axis, motion in (("swing1", Motion.SWING), ("swing2", Motion.TILT), ("twist", None)):
        yield literal(f"{axis}Limit", "float", half_range(joint) if joint.motion is motion else 0.0)
        if joint.motion is motion:
            yield middle(axis, joint)
    yield from soft_lines("softSwingConstraint", "swingStiffness", "swingDamping")
    yield from soft_lines("softTwistConstraint", "twistStiffness", "twistDamping")


def half_range(joint: Joint) -> float:
    """Returns half of the range from closed to open [m or rad]."""
    return abs(joint.opening) / 2


def middle(axis: str, joint: Joint) -> str:
    """Returns the middle of the range, relative to the closed position; positions are of the child to the parent."""
    value = joint.opening / 2 * (-1 if joint.swapped_roles else 1)
    return f'\t\t<ms:{axis}Middle rdf:datatype="&xsd;float">{value}</ms:{axis}Middle>\n'


def soft_lines(soft: str, stiffness: str, damping: str) -> Iterator[str]:
    """Yields a hard limit."""
    yield literal(soft, "boolean", "false")
    yield literal(stiffness, "float", 0.0)
    yield literal(damping, "float", 0.0)


def individual(id: str, title: str, lines: list[str]) -> str:
    """Returns an individual; without a title it has no comment, as it belongs to the previous one."""
    heading = (
        f"	<!-- {title if title in ('Constraint', 'Semantic Map') else 'Individual ' + title} -->\n" if title else ""
    )
    return f"""{heading}	<owl:NamedIndividual rdf:about="&kitchen;{id}">
{"".join(lines)}	</owl:NamedIndividual>
"""


def resource(name: str, value: str) -> str:
    """Returns a statement whose object is a resource."""
    return f'		<{name} rdf:resource="{value}"/>\n'


def literal(name: str, datatype: str, value: object) -> str:
    """Returns a statement whose object is a literal."""
    return f'		<knowrob:{name} rdf:datatype="&xsd;{datatype}">{value}</knowrob:{name}>\n'


def entity(name: str) -> str:
    """Replaces the prefix of a name by an entity."""
    return "&" + name.replace(":", ";", 1)
