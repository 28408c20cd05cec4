"""A fake of Unreal's plugin UROSWorldControl, written from the service reference without Mindstage's message classes.

It connects to a rosbridge server as the plugin does and offers its services. Every field of a request is checked; a
missing or unknown field, or one of another type, is an error. Actors have Unreal's conventions: left-handed,
centimeters, single precision.
"""

from __future__ import annotations

import threading
from typing import Any

import numpy as np

from mindstage.bridge import RosbridgeClient
from mindstage.msgs import service_type
from mindstage.scene.transforms import pose_inverse, pose_multiply

__all__ = ["Actor", "FakeUnrealPlugin"]

Json = dict[str, Any]

POINT = {"x": float, "y": float, "z": float}
POSE = {"position": POINT, "orientation": {**POINT, "w": float}}
TAG = {"type": str, "key": str, "value": str}
PHYSICS = {"mobility": {0, 1, 2, 3}, "gravity": bool, "generate_overlap_events": bool, "mass": float}
APPEARANCE = {"actor_label": str, "physics_properties": PHYSICS}
SURFACE = {"material_names": [str], "material_paths": [str]}
MODEL = {"name": str, "pose": POSE, "id": str, "tags": [TAG], "path": str, **APPEARANCE, **SURFACE}
MOTION = {0, 1, 2}
LINEAR = {
    "x_motion": MOTION, "y_motion": MOTION, "z_motion": MOTION, "limit": float,
    "use_advanced": bool, "soft_constraint": bool, "stiffness": float, "damping": float,
}  # fmt: skip
ANGULAR = {
    "swing_1_motion": MOTION, "swing_2_motion": MOTION, "twist_motion": MOTION,
    "swing_1_limit_angle": float, "swing_2_limit_angle": float, "twist_limit_angle": float,
    "angular_roation_offset": POINT, "use_advanced": bool,
    "swing_soft_constraint": bool, "swing_stiffness": float, "swing_damping": float,
    "twist_soft_constraint": bool, "twist_stiffness": float, "twist_damping": float,
}  # fmt: skip
DETAILS = {
    "id_first_model": str, "id_second_model": str, "disable_collision": bool,
    "enable_projection": bool, "projection_linear_tolerance": float, "projection_angular_tolerance": float,
    "parent_dominates": bool, "linear_limits": LINEAR, "angular_limits": ANGULAR,
}  # fmt: skip
CONSTRAINT = {"id": str, "constraint_details": DETAILS, "pose": POSE}
RELATION = {"parent_id": str, "child_id": str}
REQUESTS: dict[str, tuple[str, Json]] = {
    "spawn_semantic_map": (
        "SpawnSemanticMap",
        {"models": [MODEL], "constraints": [CONSTRAINT], "relations": [RELATION]},
    ),
    "spawn_model": (
        "SpawnModel",
        {**MODEL, "override_name": str, "parent_id": str, "spawn_collision_check": bool},
    ),
    "spawn_physics_constraint": ("SpawnPhysicsConstraint", {"constraint_description": CONSTRAINT}),
    "attach_model_to_parent": ("AttachModelToParent", RELATION),
    "delete_model": ("DeleteModel", {"id": str}),
    "delete_all": (
        "DeleteAll",
        {"type_to_delete": str, "key_to_delete": str, "value_to_delete": str, "ignore_value": bool},
    ),
    "set_model_pose": ("SetModelPose", {"id": str, "pose": POSE}),
    "get_model_pose": ("GetModelPose", {"id": str}),
    "set_physics_properties": ("SetPhysicsProperties", {"id": str, "physics_properties": PHYSICS}),
    "change_material": ("SetMaterial", {"id": str, **SURFACE}),
    "highlight_models": ("HighlightModel", {"id": str, "color": {0, 1, 2, 3, 4, 5}}),
}


def check_fields(value: Any, schema: Any, path: str) -> None:
    """Checks the fields of a request.

    Raises:
        ValueError: a field is missing, unknown, or of another type.
    """
    if isinstance(schema, dict):
        if not isinstance(value, dict) or value.keys() != schema.keys():
            raise ValueError(f"{path or 'the request'}: expected {sorted(schema)}, got {value!r:.200}")
        for name, inner in schema.items():
            check_fields(value[name], inner, f"{path}.{name}")
    elif isinstance(schema, list):
        if not isinstance(value, list):
            raise ValueError(f"{path}: expected an array")
        for number, item in enumerate(value):
            check_fields(item, schema[0], f"{path}[{number}]")
    elif isinstance(schema, set):
        if type(value) is not int or value not in schema:
            raise ValueError(f"{path}: {value!r} is none of {schema}")
    elif type(value) is not schema and not (schema is float and type(value) is int):
        raise ValueError(f"{path}: {value!r} is no {schema.__name__}")


class Actor:
    """A static mesh actor."""

    def __init__(self, model: Json) -> None:
        self.model = model
        self.color = 0
        self.parent = ""
        self.unreal_pose = to_unreal(model["pose"])

    def has_tag(self, type: str, key: str, value: str | None) -> bool:
        return any(
            (tag["type"], tag["key"]) == (type, key) and value in {None, tag["value"]} for tag in self.model["tags"]
        )


class FakeUnrealPlugin:
    """The plugin, from creation until `close`."""

    def __init__(self, url: str, *, namespace: str = "unreal") -> None:
        self.actors: dict[str, Actor] = {}
        self.joints: dict[str, Json] = {}
        self.order: list[str] = []
        """Ids in the order in which they were spawned."""
        self.obstructed: set[str] = set()
        """Ids of models whose place is obstructed."""
        self.without_mesh: set[str] = set()
        """Names of meshes that the project does not contain."""
        self.unbreakable_failures: set[str] = set()
        """Ids of joints and children that fail."""
        self.calls: list[str] = []
        self.stops_after = -1
        """Number of actors after which it stops in the middle of a map."""
        self.stopped = threading.Event()
        self._left = threading.Event()
        self._url, self._namespace = url, namespace
        self.connect()

    def connect(self) -> None:
        """Connects to the server, with the actors that exist."""
        self.stops_after = -1
        self._left.clear()
        self._client = RosbridgeClient(self._url).wait_connected(20.0)
        for name, (type, schema) in REQUESTS.items():
            service_type(f"world_control_msgs/{type}")  # fails here for a wrong name
            self._advertise(f"/{self._namespace}/{name}", type, schema, getattr(self, name))

    def close(self) -> None:
        """Disconnects at once."""
        self._client.close()
        self._left.set()

    def _advertise(self, service: str, type: str, schema: Json, handler: Any) -> None:
        def handle(args: Any) -> Json:
            self.calls.append(service.rpartition("/")[2])
            check_fields(args, schema, "")
            reply: Json = handler(args)
            return reply

        self._client.create_service(service, f"world_control_msgs/{type}", handle)

    # -- spawning ------------------------------------------------------------------------------------------------------

    def spawn_semantic_map(self, args: Json) -> Json:
        models = [model["id"] for model in args["models"] if self._spawn(model)]
        constraints = [each["id"] for each in args["constraints"] if not self._spawn_joint(each)]
        relations = [each for each in args["relations"] if not self._attach(each)]
        return {
            "success": not (models or constraints or relations),
            "failed_model_ids": models,
            "failed_constraint_ids": constraints,
            "failed_relations": relations,
        }

    def spawn_model(self, args: Json) -> Json:
        etype = self._spawn(args)
        return {
            "id": args["id"],
            "name": "" if etype else f"Actor_{len(self.actors)}",
            "etype": etype.strip(),
            "success": not etype,
        }

    def spawn_physics_constraint(self, args: Json) -> Json:
        return {"success": self._spawn_joint(args["constraint_description"])}

    def attach_model_to_parent(self, args: Json) -> Json:
        return {"success": self._attach(args)}

    def _spawn(self, model: Json) -> str:
        """The reason why a model was not spawned; empty on success."""
        id = model["id"]
        if len(self.actors) == self.stops_after:
            self.stopped.set()
            self._left.wait(20.0)
            raise ConnectionAbortedError
        if id in self.actors:
            return "1"
        if id in self.obstructed:
            return "2"
        if model["name"] in self.without_mesh:
            return " "
        self.actors[id] = Actor(model)
        self.order.append(id)
        return ""

    def _spawn_joint(self, description: Json) -> bool:
        details = description["constraint_details"]
        ends = {details["id_first_model"], details["id_second_model"]}
        if not ends <= self.actors.keys() or description["id"] in self.unbreakable_failures:
            return False
        self.joints[description["id"]] = description
        self.order.append(description["id"])
        return True

    def _attach(self, relation: Json) -> bool:
        parent, child = relation["parent_id"], relation["child_id"]
        if not {parent, child} <= self.actors.keys() or child in self.unbreakable_failures:
            return False
        self.actors[child].parent = parent
        self.order.append(f"{parent}<-{child}")
        return True

    # -- changes -------------------------------------------------------------------------------------------------------

    def delete_model(self, args: Json) -> Json:
        deleted = self.actors.pop(args["id"], None) or self.joints.pop(args["id"], None)
        for actor in self.actors.values():
            if actor.parent == args["id"]:
                actor.parent = ""
        return {"success": deleted is not None}

    def delete_all(self, args: Json) -> Json:
        value = None if args["ignore_value"] else args["value_to_delete"]
        selected = [
            id
            for id, actor in self.actors.items()
            if actor.has_tag(args["type_to_delete"], args["key_to_delete"], value)
        ]
        for id in selected:
            self.delete_model({"id": id})
        return {"success": bool(selected)}

    def set_model_pose(self, args: Json) -> Json:
        actor = self.actors.get(args["id"])
        if actor is None or args["id"] in self.obstructed:
            return {"success": False}
        pose = to_unreal(args["pose"])
        change = pose_multiply(pose, pose_inverse(actor.unreal_pose))
        actor.unreal_pose = pose
        for child in self._descendants(args["id"]):
            self.actors[child].unreal_pose = pose_multiply(change, self.actors[child].unreal_pose).astype(np.float32)
        return {"success": True}

    def get_model_pose(self, args: Json) -> Json:
        actor = self.actors.get(args["id"])
        return {"pose": to_ros(actor.unreal_pose if actor else np.eye(1, 7, 3)[0]), "success": actor is not None}

    def set_physics_properties(self, args: Json) -> Json:
        return self._change(args, "physics_properties")

    def change_material(self, args: Json) -> Json:
        return self._change(args, "material_names", "material_paths")

    def highlight_models(self, args: Json) -> Json:
        if args["id"] in self.actors and args["id"] not in self.unbreakable_failures:
            self.actors[args["id"]].color = args["color"]
            return {"success": True}
        return {"success": False}

    def _change(self, args: Json, *fields: str) -> Json:
        if args["id"] not in self.actors or args["id"] in self.unbreakable_failures:
            return {"success": False}
        self.actors[args["id"]].model |= {field: args[field] for field in fields}
        return {"success": True}

    def _descendants(self, id: str) -> list[str]:
        children = [child for child, actor in self.actors.items() if actor.parent == id]
        return children + [grandchildren for child in children for grandchildren in self._descendants(child)]


def to_unreal(pose: Json) -> np.ndarray:
    """Converts to x y z [cm], then w x y z, left-handed: mirrored in y."""
    at, rotation = pose["position"], pose["orientation"]
    row = [100 * at["x"], -100 * at["y"], 100 * at["z"], rotation["w"], -rotation["x"], rotation["y"], -rotation["z"]]
    pose = np.array(row, dtype=np.float32)
    pose[3:] /= np.linalg.norm(pose[3:])  # Unreal ignores an FQuat that is not a unit quaternion
    return pose


def to_ros(pose: np.ndarray) -> Json:
    x, y, z, w, i, j, k = map(float, pose)
    return {
        "position": {"x": x / 100, "y": -y / 100, "z": z / 100},
        "orientation": {"x": -i, "y": j, "z": -k, "w": w},
    }
