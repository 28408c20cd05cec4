@tool
class_name MindstageAssembler
extends RefCounted
## Makes the scene agree with what was decided: who moves with whom, who touches whom, which constraints hold.
##
## A change names what is different. Whatever it does not name runs on untouched: its pose, its velocity, its sleep.

const _MANY: int = 16

var stage: MindstageStage
## By the id of the body that they are the physics nodes of.
var carriers: Dictionary[String, MindstageCarrier] = {}
var joints: Dictionary[String, MindstageJoint] = {}
## For each body, those that it does not collide with.
var apart: Dictionary[String, Dictionary] = {}

var _joiner: MindstageJoiner
var _moving: Array[MindstageCarrier] = []
var _moving_known: bool = false


func _init(its_stage: MindstageStage) -> void:
	stage = its_stage
	_joiner = MindstageJoiner.new(self)


## The carriers that the physics moves.
func moving() -> Array[MindstageCarrier]:
	if not _moving_known:
		_moving_known = true
		_moving.assign(carriers.values().filter(func(each: MindstageCarrier) -> bool: return each.simulates()))
	return _moving


## Makes a change: `PlanChange` of mindstage_msgs' plans.
func apply(change: Dictionary) -> void:
	var stirred: Array[AABB] = []
	var motions: Dictionary[String, Array] = {}
	_moving_known = false
	var dirty: Dictionary[String, bool] = _regroup(change.get("bodies", {}), motions, stirred)
	for id: String in dirty:
		_rebuild(id, motions)
	_joiner.change(change.get("joints", {}), dirty)
	_keep_apart(change.get("apart", []), change.get("together", []), dirty)
	_put(change.get("poses", {}), stirred)
	_wake(stirred)


## Takes bodies out of the scene; what else was in their carriers is the next change's to place.
func remove(bodies: Array[MindstageBody], gone_joints: PackedStringArray) -> void:
	var stirred: Array[AABB] = []
	_moving_known = false
	_joiner.remove(gone_joints)
	for body: MindstageBody in bodies:
		stirred.append(body.carrier.bounds())
		body.carrier.members.erase(body)
		for other: String in apart.get(body.id, {}):
			apart[other].erase(body.id)
		apart.erase(body.id)
	var orphans: Dictionary = {}
	var motions: Dictionary[String, Array] = {}
	for body: MindstageBody in bodies:
		if body.carrier.id != body.id:
			discard(body.node)
			continue
		for left: MindstageBody in body.carrier.members:
			motions[left.id] = [body.carrier.velocity_at(left.last.origin), body.carrier.angular_velocity()]
			orphans[left.id] = left
	for index: int in range(bodies.size() - 1, -1, -1):  # from the last: a node with many children is quicker so
		if bodies[index].carrier.id == bodies[index].id:
			_free(bodies[index].carrier, orphans)
	for id: String in orphans:
		_stand_alone(orphans[id], motions)
	_wake(stirred)


## What was decided about constraints, to keep.
func copy_joins() -> Dictionary[String, Dictionary]:
	return _joiner.copy_joins()


## Takes that over again.
func set_joins(joins: Dictionary[String, Dictionary]) -> void:
	_joiner.set_joins(joins)


## Forgets all, so that nothing keeps anything else alive.
func let_go() -> void:
	for id: String in carriers:
		carriers[id].members.clear()
	carriers.clear()
	_moving.clear()
	_joiner = null


## Whether two bodies' carriers are kept from colliding.
func are_apart(one: MindstageCarrier, other: MindstageCarrier) -> bool:
	for body: MindstageBody in one.members:
		var partners: Dictionary = apart.get(body.id, {})
		for partner: MindstageBody in other.members:
			if partners.has(partner.id):
				return true
	return false


func _regroup(parts: Dictionary, motions: Dictionary[String, Array], stirred: Array[AABB]) -> Dictionary[String, bool]:
	var dirty: Dictionary[String, bool] = {}
	for id: String in parts:
		var body: MindstageBody = stage.inventory.bodies.get(id)
		if body == null:
			push_error("Mindstage: the plan names a body '%s' that is not there" % id)
			continue
		var old: MindstageCarrier = body.carrier
		var same: bool = old != null and _touches_alike(body.part, parts[id])
		body.part = parts[id]
		if same:
			continue
		if old != null:
			motions[id] = [old.velocity_at(body.last.origin), old.angular_velocity()]
			stirred.append(old.bounds())
			dirty[old.id] = true
			old.members.erase(body)
		var carrier: MindstageCarrier = _carrier(body.carrier_id())
		carrier.members.insert(0 if carrier.id == id else carrier.members.size(), body)
		body.carrier = carrier
		dirty[carrier.id] = true
	return dirty


## Whether the physics does not care which of two decisions holds.
static func _touches_alike(one: Dictionary, other: Dictionary) -> bool:
	var still: bool = one.get("mobility", "static") != "dynamic" and other.get("mobility", "static") != "dynamic"
	for key: String in ["top", "hold", "mobility", "gravity", "mass_kg", "ghost", "solids", "friction", "restitution"]:
		if still and key in ["top", "hold"]:
			continue
		if one.get(key) != other.get(key):
			return false
	return true


func _carrier(id: String) -> MindstageCarrier:
	if not carriers.has(id):
		carriers[id] = MindstageCarrier.new()
		carriers[id].id = id
	return carriers[id]


func _rebuild(id: String, motions: Dictionary[String, Array]) -> void:
	var carrier: MindstageCarrier = carriers[id]
	if carrier.members.is_empty():
		_free(carrier, {})
		return
	var old: CollisionObject3D = carrier.node
	MindstageSpawner.build(carrier, stage, carrier.members[0].last)
	for body: MindstageBody in carrier.members:
		_seat(body, carrier)
	if carrier.node == old:
		return
	var motion: Array = motions.get(id, [])
	var rigid: RigidBody3D = carrier.node as RigidBody3D
	if rigid != null and motion:
		rigid.linear_velocity = motion[0]
		rigid.angular_velocity = motion[1]
		var lever: Vector3 = rigid.basis * MindstageMatter.middle(carrier)
		rigid.linear_velocity += (motion[1] as Vector3).cross(lever)
	carrier.last = carrier.place()
	if old != null:
		discard(old)


## Gives a body its node: the carrier's own, or a place of its own under it.
func _seat(body: MindstageBody, carrier: MindstageCarrier) -> void:
	var old: Node3D = body.node
	if body.id == carrier.id:
		body.node = carrier.node
	elif old == null or old is CollisionObject3D or old.get_parent() != carrier.node:
		body.node = Node3D.new()
		body.node.name = body.id.validate_node_name()
		carrier.node.add_child(body.node)
	if body.node != carrier.node:
		body.node.transform = body.hold()
	if old != body.node:
		MindstageTags.write(body.node, body.data)
		if old != null:
			stage.move_looks(body, old)
			if not old is CollisionObject3D:
				discard(old)


func _stand_alone(body: MindstageBody, motions: Dictionary[String, Array]) -> void:
	body.part = body.part.merged({"top": body.id, "hold": {}}, true)
	body.carrier = _carrier(body.id)
	body.carrier.members.assign([body])
	_rebuild(body.id, motions)


func _free(carrier: MindstageCarrier, keep: Dictionary) -> void:
	carriers.erase(carrier.id)
	for id: String in keep:
		var body: MindstageBody = keep[id]
		if body.carrier == carrier and body.node.get_parent() == carrier.node and not Engine.is_editor_hint():
			carrier.node.remove_child(body.node)
	discard(carrier.node)


func _keep_apart(pairs: Array, together: Array, dirty: Dictionary[String, bool]) -> void:
	for pair: Array in pairs:
		_partners(pair[0])[pair[1]] = true
		_partners(pair[1])[pair[0]] = true
		except(pair)
	for pair: Array in together:
		_partners(pair[0]).erase(pair[1])
		_partners(pair[1]).erase(pair[0])
		except(pair)
	if apart.is_empty():
		return
	for id: String in dirty:
		if carriers.has(id):
			for body: MindstageBody in carriers[id].members:
				for other: String in apart.get(body.id, {}):
					except([body.id, other])


func _partners(id: String) -> Dictionary:
	if not apart.has(id):
		apart[id] = {}
	return apart[id]


## Lets two bodies' carriers collide, or not, as was decided.
func except(pair: Array) -> void:
	var one: MindstageBody = stage.inventory.bodies.get(pair[0])
	var other: MindstageBody = stage.inventory.bodies.get(pair[1])
	if one == null or other == null or one.carrier == other.carrier:
		return
	if not (one.carrier.simulates() or other.carrier.simulates()):
		return
	var a: PhysicsBody3D = one.carrier.node as PhysicsBody3D
	var b: PhysicsBody3D = other.carrier.node as PhysicsBody3D
	if are_apart(one.carrier, other.carrier):
		a.add_collision_exception_with(b)
		b.add_collision_exception_with(a)
	else:
		a.remove_collision_exception_with(b)
		b.remove_collision_exception_with(a)


func _put(poses: Dictionary, stirred: Array[AABB]) -> void:
	for id: String in poses:
		var body: MindstageBody = stage.inventory.bodies.get(id)
		if body == null:
			push_error("Mindstage: the plan puts a body '%s' that is not there" % id)
			continue
		stirred.append(body.carrier.bounds())
		stage.write_pose(body, poses[id])
		body.moved = true
		if body.carrier.id == id:
			body.carrier.put(body.last)
		stirred.append(body.carrier.bounds())


## Wakes what sleeps where something changed.
func _wake(stirred: Array[AABB]) -> void:
	if stirred.is_empty() or Engine.is_editor_hint():
		return
	var regions: Array[AABB] = []
	for box: AABB in stirred:
		if regions.size() < _MANY:
			regions.append(box.grow(0.02))
		else:
			regions[-1] = regions[-1].merge(box.grow(0.02))
	for carrier: MindstageCarrier in moving():
		var box: AABB = carrier.bounds()
		if regions.any(func(region: AABB) -> bool: return region.intersects(box)):
			carrier.wake()


## Takes a node away; the editor keeps it for undo.
static func discard(node: Node) -> void:
	if node.get_parent() != null:
		node.get_parent().remove_child(node)
	if not Engine.is_editor_hint():
		node.queue_free()
