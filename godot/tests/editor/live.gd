extends SceneTree
## Runs a scene that the editor saved: `--script tests/editor/live.gd -- SCENE`; 0 if it lives as the map says.


func _initialize() -> void:
	var scene: Node = (load(OS.get_cmdline_user_args()[0]) as PackedScene).instantiate()
	root.add_child(scene)
	await process_frame
	var stage: MindstageStage = _stage_in(scene)
	if stage == null or not stage.assembler.joints.has("door_hinge"):
		print("there is no stage in it, or no door")
		quit(2)
		return
	stage.clock.play(0.0)
	stage.push("door_handle", MindstageFrames.vector(25.0, 0.0, 0.0), null)
	await stage.step(3.0)
	var angle: float = stage.assembler.joints["door_hinge"].position_of_axes()[5]
	var crate_m: float = stage.rows()[stage.inventory.bodies["crate"].row * MindstageFrames.ROW + 2]
	print("door %.4f rad, crate %.4f m" % [angle, crate_m])
	quit(0 if absf(angle - PI / 4.0) < 0.01 and absf(crate_m - 0.15) < 0.005 else 1)


func _stage_in(scene: Node) -> MindstageStage:
	for node: Node in scene.find_children("*", "Node3D"):
		if node is MindstageStage:
			return node
	return null
