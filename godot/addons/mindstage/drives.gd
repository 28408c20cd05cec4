@tool
class_name MindstageDrives
extends RefCounted
## The actuators of all joints: their commands and states.

var physics_scene: MindstagePhysicsScene
## Commands by the name of the actuator.
var _commands: Dictionary[String, float] = {}


func _init(owner_scene: MindstagePhysicsScene) -> void:
	physics_scene = owner_scene


## Forgets the commands of actuators; until the next one, a servo holds its position, and the others have 0.
func forget(names: Array) -> void:
	for name: String in names:
		_commands.erase(name)


## Sets commands. Returns why it cannot, or an empty string.
func set_commands(names: Array, commands: Array) -> String:
	if names.size() != commands.size():
		return "there are %d names and %d commands" % [names.size(), commands.size()]
	var joint_of: Dictionary[String, MindstageJoint] = _joints_by_drive()
	for name: String in names:
		if not joint_of.has(name):
			return "there is no actuator '%s'" % name
	for index: int in names.size():
		if _commands.get(names[index], NAN) != commands[index]:
			joint_of[names[index]].wake()
		_commands[names[index]] = commands[index]
	return ""


## Exerts the efforts of all actuators for one tick.
func apply() -> void:
	for id: String in physics_scene.joints:
		var joint: MindstageJoint = physics_scene.joints[id]
		for drive: MindstageDrive in joint.drives:
			joint.exert(drive, _command(joint, drive))


## The state of each actuator, as messages.
func states() -> Array:
	var found: Array = []
	for id: String in physics_scene.joints:
		var joint: MindstageJoint = physics_scene.joints[id]
		for drive: MindstageDrive in joint.drives:
			(
				found
				. append(
					{
						"name": drive.name,
						"position": joint.drive_position(drive),
						"velocity": joint.velocity_along(drive.axis),
						"effort": drive.effort,
						"command": _command(joint, drive),
					}
				)
			)
	return found


## The command of an actuator; the first one is the current position, or 0.
func _command(joint: MindstageJoint, drive: MindstageDrive) -> float:
	if not _commands.has(drive.name):
		_commands[drive.name] = joint.drive_position(drive) if drive.mode == MindstageDrive.POSITION else 0.0
	return _commands[drive.name]


func _joints_by_drive() -> Dictionary[String, MindstageJoint]:
	var found: Dictionary[String, MindstageJoint] = {}
	for id: String in physics_scene.joints:
		for drive: MindstageDrive in physics_scene.joints[id].drives:
			found[drive.name] = physics_scene.joints[id]
	return found
