@tool
class_name MindstagePlanner
extends RefCounted
## Decides by the simplest rules, where nobody told what was decided: what hangs together moves together, what is joined
## does not collide, and what has no mass weighs what its box would.
##
## Mindstage itself decides better and tells it: see `PlanChange` of mindstage_msgs.

const SIZE_ASSUMED_M: float = 0.1
const DENSITY_ASSUMED: float = 200.0
const LEAST_KG: float = 0.01
const MOST_KG: float = 100.0


## What is different for all bodies there, as a change of the plan.
static func plan(inventory: MindstageInventory, rows: PackedFloat64Array, known: Dictionary) -> Dictionary:
	var joined: Dictionary[String, bool] = {}
	var joints: Dictionary = {}
	var apart: Array = []
	for id: String in inventory.constraints:
		var constraint: Dictionary = MindstageJsonText.read(inventory.constraints[id])
		joined[constraint["parent"]] = true
		joined[constraint["child"]] = true
	var bodies: Dictionary = {}
	for id: String in inventory.bodies:
		var part: Dictionary = _part(inventory, id, joined, rows)
		if not _is_same(part, inventory.bodies[id].part):
			bodies[id] = part
	for id: String in inventory.constraints:
		if known.has(id):
			continue
		var constraint: Dictionary = MindstageJsonText.read(inventory.constraints[id])
		joints[id] = _joint(inventory, constraint, rows)
		if constraint.get("disable_collision") != false:
			apart.append([constraint["parent"], constraint["child"]])
	return {"bodies": bodies, "joints": joints, "apart": apart}


## The body that another one's rigid assembly hangs on.
static func top_of(inventory: MindstageInventory, id: String, joined: Dictionary[String, bool]) -> String:
	var here: String = id
	while inventory.parents.has(here) and not (_is_dynamic(inventory, here) and joined.has(here)):
		here = inventory.parents[here]
	return here


static func _part(
	inventory: MindstageInventory, id: String, joined: Dictionary[String, bool], rows: PackedFloat64Array
) -> Dictionary:
	var body: MindstageBody = inventory.bodies[id]
	var told: Variant = body.data.get("size")
	var size: Array = told if told is Array else [SIZE_ASSUMED_M, SIZE_ASSUMED_M, SIZE_ASSUMED_M]
	size = size.map(func(part: float) -> float: return maxf(part, 0.001))
	var top: String = top_of(inventory, id, joined)
	var mobility: Variant = inventory.bodies[top].physics().get("mobility")
	var kind: String = "static" if mobility == null or mobility == "stationary" else str(mobility)
	var shape: Dictionary = body.data.get("shape", {})
	var mass: float = MindstageFrames.number(body.physics().get("mass_kg", 0.0))
	if not mass > 0.0:
		mass = clampf(size[0] * size[1] * size[2] * DENSITY_ASSUMED, LEAST_KG, MOST_KG)
	var part: Dictionary = {
		"size": size,
		"top": top,
		"mobility": kind,
		"gravity": body.physics().get("gravity") != false,
		"mass_kg": mass if kind == "dynamic" else 0.0,
		"solids": body.form.get("solids", [{"kind": shape.get("kind", "box"), "size": size}]),
	}
	if top != id:
		part["hold"] = relative(rows, inventory.bodies[top].row, body.row)
	return part


## A body's pose in another one's frame.
static func relative(rows: PackedFloat64Array, holder: int, held: int) -> Dictionary:
	var place: Transform3D = (
		MindstageFrames.transform_at(rows, holder).affine_inverse() * MindstageFrames.transform_at(rows, held)
	)
	var row: PackedFloat64Array = []
	row.resize(MindstageFrames.ROW)
	MindstageFrames.write_row(row, 0, place.orthonormalized())
	return MindstageFrames.pose_from_row(row, 0)


static func _joint(inventory: MindstageInventory, constraint: Dictionary, rows: PackedFloat64Array) -> Dictionary:
	var ends: Array[String] = [constraint["parent"], constraint["child"]]
	var both: PackedFloat64Array = []
	for end: String in ends:
		var at: int = inventory.bodies[end].row * MindstageFrames.ROW
		both.append_array(rows.slice(at, at + MindstageFrames.ROW))
	both.append_array(MindstageFrames.row_from(constraint["pose"]))
	return {"parent": ends[0], "child": ends[1], "of_parent": relative(both, 0, 2), "of_child": relative(both, 1, 2)}


static func _is_dynamic(inventory: MindstageInventory, id: String) -> bool:
	return inventory.bodies[id].physics().get("mobility") == "dynamic"


static func _is_same(one: Dictionary, other: Dictionary) -> bool:
	# Where a body hangs is asked again only when it hangs on something else.
	for key: String in one:
		if key != "hold" and one[key] != other.get(key):
			return false
	return one.size() == other.size()
